"use strict";
// Unpacks what the page holds, draws plots and arm, and ties the clock of one to the cursor of the other.
async function held(name) {
  const element = document.getElementById("held-" + name);
  if (!element) return null;
  const bytes = Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

async function library(name) {
  const text = await held(name);
  if (text === null) return false;
  const script = document.createElement("script");
  script.textContent = text;
  document.head.append(script);
  return true;
}

(async () => {
  const data = JSON.parse(await held("data"));
  const closest = data.player && data.player.closest ? data.player.closest.time : null;
  const charts = new Charts(data.charts, closest);
  if (await library("plotly")) await charts.draw();
  let player = null;
  if (data.player && await library("three")) {
    try {
      player = new Player(document.getElementById("player"), data.player);
      player.onTime = (time) => charts.show(time);
      charts.onTime = (time) => { player.playing = false; player.seek(time); };
      player.seek(0);
    } catch (error) {
      document.getElementById("player").textContent = "This browser has no WebGL, which the moving arm needs.";
    }
  }
  const restyle = () => { charts.restyle(); if (player) player.seek(player.time); };
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", restyle);
  window.addEventListener("resize", restyle);
  document.body.dataset.ready = document.documentElement.scrollWidth > window.innerWidth ? "too wide" : "yes";
})();
