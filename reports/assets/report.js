"use strict";
// Sortable tables, the settings table's "only differences", and a viewer for every scene once it is near the screen.

function sortBy(header) {
  const table = header.closest("table");
  const row = header.parentElement;
  const column = [...row.children].indexOf(header);
  const down = header.getAttribute("aria-sort") === "ascending";
  for (const other of row.children) if (other.hasAttribute("aria-sort")) other.setAttribute("aria-sort", "none");
  header.setAttribute("aria-sort", down ? "descending" : "ascending");
  const text = header.dataset.kind === "text";
  const value = (line) => line.children[column].dataset.value;
  const compare = (a, b) => {
    const x = value(a), y = value(b);
    if (x === undefined || y === undefined) return (x === undefined) - (y === undefined); // what was not measured stays below
    const order = text ? x.localeCompare(y, "en", { numeric: true }) : Number(x) - Number(y);
    return down ? -order : order;
  };
  const body = table.tBodies[0];
  body.append(...[...body.rows].sort(compare));
}

for (const header of document.querySelectorAll("table.sortable thead th[aria-sort]")) {
  header.querySelector("button").addEventListener("click", () => sortBy(header));
}

for (const box of document.querySelectorAll(".only-differences")) {
  box.addEventListener("change", () => {
    const details = box.closest("details");
    details.querySelector("table.settings").classList.toggle("differences", box.checked);
    const none = details.querySelector("tr.differs") === null;
    details.querySelector(".none-differ").hidden = !(box.checked && none);
  });
}

const viewers = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    if (!entry.isIntersecting) continue;
    viewers.unobserve(entry.target);
    luxmeter.open(entry.target, JSON.parse(document.getElementById(entry.target.dataset.viewer).textContent));
  }
}, { rootMargin: "400px" });
for (const place of document.querySelectorAll(".viewer")) viewers.observe(place);
