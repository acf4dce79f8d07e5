"use strict";
(() => {
  const data = JSON.parse(document.getElementById("nrsfm-data").textContent);
  const { inOrder, listen, player, plots } = nrsfmTools(data);
  const starts = [], { run } = data;
  if (run.view) {
    const { element, start, keys } = player(run);
    document.getElementById("stage").replaceChildren(element);
    starts.push(start);
    listen(document, (key) => keys[key]);
  }
  for (const { box, start } of plots(run)) {
    document.getElementById("plots").append(box);
    starts.push(start);
  }
  inOrder(starts);
})();
