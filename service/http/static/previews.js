"use strict";
// Loads previews that are not drawn yet one after another: a browser has few connections, and drawing one takes a second.

function next() {
  const image = document.querySelector("img[data-preview]");
  if (image === null) return;
  image.addEventListener("load", next);
  image.addEventListener("error", next);
  image.src = image.dataset.preview;
  delete image.dataset.preview;
}
window.addEventListener("load", next);
