"use strict";
(async () => {
  const data = JSON.parse(document.getElementById("nrsfm-data").textContent);
  const { arrays, inOrder, listen, player, plots, ready } = nrsfmTools(data);
  const starts = [], { run } = data, stage = document.getElementById("stage");
  if (run.view) stage.replaceChildren("Reading the view …");
  try {
    await ready(...arrays(run));
  } catch (error) {
    return stage.replaceChildren(error.message);
  }
  if (run.view) {
    const { element, start, keys } = player(run);
    stage.replaceChildren(element);
    starts.push(start);
    listen(document, (key) => keys[key]);
  }
  for (const { box, start } of plots(run)) {
    document.getElementById("plots").append(box);
    starts.push(start);
  }
  inOrder(starts);
})();
