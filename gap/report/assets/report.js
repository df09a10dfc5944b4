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

  const select = document.getElementById("trace");
  if (select) {
    const choices = read("traces");
    const show = () => {
      const choice = choices[select.selectedIndex];
      Plotly.update("comparison", choice.data, choice.layout);
      const chosen = select.selectedOptions[0];
      document.getElementById("shown").textContent = `${chosen.label} (${chosen.parentNode.label})`;
    };
    select.addEventListener("change", show);
    show();
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
