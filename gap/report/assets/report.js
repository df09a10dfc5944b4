"use strict";
(() => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  // The buttons are listed, since plotly's own set has one that uploads the data.
  const config = {
    responsive: true,
    displaylogo: false,
    showSendToCloud: false,
    plotlyServerURL: "",
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d", "toImage"]],
  };
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const figures = read("figures");
  const plots = Object.keys(figures).map((id) => document.getElementById(id));

  for (const plot of plots) {
    const {data, layout} = figures[plot.id];
    const zoomable = layout.dragmode === "zoom";
    // A finger that scrolls the page must not zoom the figure; its buttons still do.
    layout.dragmode = zoomable && !touch ? "zoom" : false;
    Plotly.newPlot(plot, data, layout, {...config, displayModeBar: zoomable && (touch || "hover")});
  }

  const HOLE = 65535;
  const unpacked = ({offset, step, data}) => {
    const bytes = Uint8Array.from(atob(data), (char) => char.charCodeAt(0));
    const codes = new DataView(bytes.buffer);
    return Array.from({length: bytes.length / 2}, (_, k) => {
      const code = codes.getUint16(2 * k, true);
      return code === HOLE ? null : offset + step * code;
    });
  };
  const both = (a, b, sum) => a.map((x, k) => (x === null || b[k] === null ? null : sum(x, b[k])));
  // Plotly reads tags in text, and mathematics between dollars.
  const literal = (text) => text.replace(/[&<>$]/g, (char) => `&#${char.charCodeAt(0)};`);

  const selects = ["recording", "joint", "signal"].map((id) => document.getElementById(id));
  if (selects[0]) {
    const traces = read("traces");
    const shown = document.getElementById("shown");
    const show = () => {
      const [recording, joint, signal] = selects.map((select) => select.value);
      const trace = traces.find((one) => (
        one.recording === recording && one.joint === joint && one.signal === signal
      ));
      if (!trace) {
        shown.textContent = `${recording}: ${joint}, ${signal} was not recorded`;
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
    selects.forEach((select) => select.addEventListener("change", show));
    show();
  }

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

  // Paper has a width of its own, and what is folded away cannot be opened on it.
  const folded = () => document.querySelectorAll("details:not([open])");
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = [...folded()];
    opened.forEach((details) => { details.open = true; });
    plots.forEach((plot) => Plotly.relayout(plot, {width: 640}));
  });
  window.addEventListener("afterprint", () => {
    opened.forEach((details) => { details.open = false; });
    plots.forEach((plot) => Plotly.relayout(plot, {width: null, autosize: true}));
  });
})();
