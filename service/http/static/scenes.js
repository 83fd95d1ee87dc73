"use strict";
// Uploads a scene and shows it.

const form = document.getElementById("upload");
const problem = document.getElementById("problem");
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  problem.hidden = true;
  const file = document.getElementById("file").files[0];
  const button = form.querySelector("button");
  button.disabled = true;
  const address = `/v1/scenes?description=${encodeURIComponent(file.name.replace(/\.glb$/i, "").slice(0, 200))}`;
  const answer = await fetch(address, { method: "POST", headers: { "content-type": "model/gltf-binary" }, body: file });
  const found = await answer.json();
  button.disabled = false;
  if (answer.ok) {
    location.hash = found.name;
    location.reload();
    return;
  }
  problem.textContent = `${found.title}: ${found.detail}`;
  problem.hidden = false;
});
