"use strict";
(async () => {
  const said = (id) => document.getElementById(id)?.textContent;
  // What the page carries is packed.
  const unzipped = async (id) => {
    const bytes = Uint8Array.from(atob(said(id)), (char) => char.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  // What had no room in the page is not there.
  const read = async (id, otherwise) => (said(id) ? JSON.parse(await unzipped(id)) : otherwise);

  const HOLE = 65535;
  const unpacked = ({offset, step, data}) => {
    const bytes = Uint8Array.from(atob(data), (char) => char.charCodeAt(0));
    const half = bytes.length / 2;
    let code = 0;
    return Array.from({length: half}, (_, k) => {
      code = (code + bytes[k] + 256 * bytes[half + k]) & HOLE;
      return code === HOLE ? null : offset + step * code;
    });
  };
  const both = (a, b, sum) => a.map((x, k) => (x === null || b[k] === null ? null : sum(x, b[k])));
  // Plotly reads tags in text, and mathematics between dollars.
  const literal = (text) => text.replace(/[&<>$]/g, (char) => `&#${char.charCodeAt(0)};`);

  for (const code of document.querySelectorAll("pre > code")) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "Copy";
    button.addEventListener("click", () => {
      const range = document.createRange();
      range.selectNodeContents(code);
      const selection = window.getSelection();
      selection.removeAllRanges();
      selection.addRange(range);
      // A page that was opened from a file may have no clipboard of the newer kind.
      button.textContent = document.execCommand("copy") ? "Copied" : "Selected";
    });
    code.closest(".code").append(button);
  }

  if (!window.DecompressionStream) {
    document.getElementById("old").hidden = false;
    return;
  }
  const script = document.createElement("script");
  script.textContent = await unzipped("plotly");
  document.head.append(script);

  // The buttons are listed, since plotly's own set has one that uploads the data.
  const config = {
    responsive: true,
    displaylogo: false,
    showSendToCloud: false,
    plotlyServerURL: "",
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]],
  };
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const figures = JSON.parse(said("figures"));
  const plots = Object.keys(figures).map((id) => document.getElementById(id));

  // Figures are made for white paper; in the dark their inks change, and what is behind text.
  const DARK = {
    "#000000": "#f2f2f2", "#FFFFFF": "#16181b", "#E4E4E4": "#33373c", "#999999": "#767b82",
    "#767676": "#9aa0a6", "#D55E00": "#ff8a3d", "#0072B2": "#5cb8ee", "#56B4E9": "#2f7fb3",
  };
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const inked = (figure, night) => {
    const text = JSON.stringify(figure);
    if (!night) return JSON.parse(text);
    const turned = JSON.parse(text.replace(/#[0-9A-F]{6}\b/g, (color) => DARK[color] ?? color));
    turned.layout.font = {...turned.layout.font, color: "#e6e6e6"};
    return turned;
  };
  const plotted = (plot, night) => {
    const {data, layout} = inked(figures[plot.id], night);
    const zoomable = layout.dragmode === "zoom";
    // A finger that scrolls the page must not zoom the figure; its buttons still do.
    layout.dragmode = zoomable && !touch ? "zoom" : false;
    const shown = {...config, displayModeBar: zoomable && (touch || "hover")};
    return Plotly.react(plot, data, layout, shown);
  };
  for (const plot of plots) plotted(plot, dark.matches);

  const selects = ["recording", "joint", "signal"].map((id) => document.getElementById(id));
  const traces = await read("traces", []);
  const show = () => {
    const shown = document.getElementById("shown");
    const [recording, joint, signal] = selects.map((select) => select.value);
    const trace = traces.find((one) => (
      one.recording === recording && one.joint === joint && one.signal === signal
    ));
    if (!trace) {
      const one = traces.some((other) => other.recording === recording);
      shown.textContent = one ? `${recording}: ${joint}, ${signal} was not recorded`
        : `${recording} is not in this page, which would be too large with it`;
      Plotly.restyle("comparison", {x: [[]], y: [[]]});
      return;
    }
    const time = unpacked(trace.time);
    const measured = unpacked(trace.measured);
    const errors = trace.errors.map(unpacked);
    const simulated = errors.map((error) => both(error, measured, (e, m) => m + e));
    const scaled = errors.map((error) => (
      error.map((e) => (e === null ? null : e * trace.errorFactor))
    ));
    const commanded = trace.commanded ? unpacked(trace.commanded) : [];
    const series = [measured, commanded, ...simulated, ...scaled];
    const again = Object.fromEntries(
      ["xaxis", "xaxis2", "yaxis", "yaxis2"].map((axis) => [`${axis}.autorange`, true]));
    Plotly.update("comparison", {
      x: series.map((values) => (values.length ? time : [])),
      y: series,
      visible: series.map((values) => values.length > 0),
    }, {
      ...again,
      "yaxis.title.text": literal(`${trace.signal} [${trace.unit}]`),
      "yaxis2.title.text": literal(`error [${trace.errorUnit}]`),
      "shapes[0].y0": -trace.floor,
      "shapes[0].y1": trace.floor,
    });
    const half = trace.heldOut ? "held out" : "fitted";
    shown.textContent = `${recording} (${half}): ${joint}, ${signal}`;
  };
  if (selects[0]) {
    selects.forEach((select) => select.addEventListener("change", show));
    show();
  }

  const drawn = await robotMoving({read, unpacked});

  const inks = (night) => {
    for (const plot of plots) plotted(plot, night);
    if (selects[0]) show();
    drawn();
  };
  dark.addEventListener("change", () => inks(dark.matches));

  // Paper is white and has a width of its own, and what is folded away cannot be opened on it.
  const folded = () => document.querySelectorAll("details:not([open])");
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = [...folded()];
    opened.forEach((details) => { details.open = true; });
    if (dark.matches) inks(false);
    plots.forEach((plot) => Plotly.relayout(plot, {width: 640}));
  });
  window.addEventListener("afterprint", () => {
    opened.forEach((details) => { details.open = false; });
    plots.forEach((plot) => Plotly.relayout(plot, {width: null, autosize: true}));
    if (dark.matches) inks(true);
  });
  document.documentElement.dataset.ready = "";
})();
