"use strict";
(() => {
  const data = JSON.parse(document.getElementById("nrsfm-data").textContent);
  const { player, plots } = nrsfmTools(data);
  const starts = [], { run } = data;
  if (run.view) {
    const { element, start, keys } = player(run);
    document.getElementById("stage").replaceChildren(element);
    starts.push(start);
    document.addEventListener("keydown", (event) => {
      const own = { INPUT: "Arrow", BUTTON: " ", SELECT: "" }[event.target.tagName];
      if (!keys[event.key] || (own !== undefined && event.key.startsWith(own))) return;  // the element knows the key itself
      event.preventDefault();
      keys[event.key]();
    });
  }
  for (const { box, start } of plots(run)) {
    document.getElementById("plots").append(box);
    starts.push(start);
  }
  starts.reduce((before, start) => before.then(start), Promise.resolve());
})();
