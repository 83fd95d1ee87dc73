"use strict";
// Turns the form into an evaluation request. A request after # in the address fills the form.

const form = document.getElementById("submit");
const problem = document.getElementById("problem");
const number = (id) => Number(document.getElementById(id).value);
const NUMBERS = ["width", "height", "seeds", "first", "last", "noise", "priority"];

function scenes() {
  const ticked = [...form.querySelectorAll("[name=scene]:checked")].map((box) => box.value);
  const typed = document.getElementById("more").value.split(/\s+/).map((name) => name.replace(/,$/, "")).filter(Boolean);
  return [...new Set([...ticked, ...typed])];
}

function method(details) {
  const settings = {}, sweep = {};
  for (const input of details.querySelectorAll("[data-setting]")) {
    const values = input.value.split(",").map((text) => text.trim()).filter(Boolean).map((text) => text === "none" ? null : text);
    if (values.length === 1) settings[input.dataset.setting] = values[0];
    if (values.length > 1) sweep[input.dataset.setting] = values;
  }
  return { name: details.dataset.method, settings, sweep };
}

// Text as `--references` of the command line takes it, and back: "10, 0:19" is every 10th frame and a window. Nothing: the default.
function references() {
  const text = document.getElementById("references").value.trim();
  if (text === "") return null;
  const parts = text === "all" ? ["1"] : text.split(",").map((part) => part.trim());
  const every = parts.find((part) => !part.includes(":"));
  return { every: every === undefined ? null : Number(every), windows: parts.filter((part) => part.includes(":")).map((part) => part.split(":").map(Number)) };
}

function written(chosen) {
  if (chosen === null || chosen === undefined) return "";
  return [chosen.every, ...(chosen.windows ?? []).map((ends) => ends.join(":"))].filter((part) => part !== null && part !== undefined).join(", ");
}

function request() {
  const chosen = [...form.querySelectorAll("details.method")].filter((details) => details.querySelector("[name=method]").checked);
  return {
    scenes: scenes(), methods: chosen.map(method), size: [number("width"), number("height")], seeds: number("seeds"),
    frames: [number("first"), number("last")], references: references(), noise: number("noise"), priority: number("priority"),
  };
}

function show(text) {
  problem.textContent = text;
  problem.hidden = text === "";
}

function count() {
  const asked = request();
  const variants = asked.methods.reduce((sum, one) => sum + Object.values(one.sweep).reduce((product, values) => product * values.length, 1), 0);
  const cells = asked.scenes.length * variants * asked.seeds * Math.max(asked.frames[1] - asked.frames[0] + 1, 0);
  document.getElementById("count").textContent = `${cells} render${cells === 1 ? "" : "s"}`;
}

function fill(asked) {
  const boxes = new Map([...form.querySelectorAll("[name=scene]")].map((box) => [box.value, box]));
  for (const box of boxes.values()) box.checked = asked.scenes.includes(box.value);
  document.getElementById("more").value = asked.scenes.filter((name) => !boxes.has(name)).join(" ");
  for (const details of form.querySelectorAll("details.method")) {
    const own = asked.methods.find((one) => one.name === details.dataset.method);
    details.querySelector("[name=method]").checked = own !== undefined;
    details.open = own !== undefined;
    for (const [key, value] of Object.entries(own === undefined ? {} : { ...own.settings, ...own.sweep })) {
      const input = details.querySelector(`[data-setting="${CSS.escape(key)}"]`);
      if (input !== null) input.value = [value].flat().map((one) => one === null ? "none" : String(one)).join(", ");
    }
  }
  const values = [...asked.size, asked.seeds, ...asked.frames, asked.noise, asked.priority];
  NUMBERS.forEach((id, k) => { document.getElementById(id).value = values[k]; });
  document.getElementById("references").value = written(asked.references);
}

form.addEventListener("input", count);
form.addEventListener("change", (event) => {
  if (event.target.name === "method" && event.target.checked) event.target.closest("details").open = true;
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  show("");
  const asked = request();
  if (asked.scenes.length === 0 || asked.methods.length === 0) return show("Choose at least one scene and one method.");
  const button = form.querySelector("button.primary");
  button.disabled = true;
  const answer = await fetch("/v1/evaluations", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(asked) });
  const found = await answer.json();
  button.disabled = false;
  if (answer.ok) location.assign(found.links.page);
  else show(`${found.title}: ${found.detail}`);
});
if (location.hash.length > 1) fill(JSON.parse(decodeURIComponent(location.hash.slice(1))));
count();
