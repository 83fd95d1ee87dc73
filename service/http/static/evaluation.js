"use strict";
// Follows an evaluation by its events, shows its cells as they fill in, and cancels or retries it.

const section = document.getElementById("evaluation");
const problem = document.getElementById("problem");
const log = document.getElementById("log");
const api = `/v1/evaluations/${section.dataset.id}`;
const MOST_LINES = 500;
let waiting = false;

function line(event) {
  const { seq, time, ...rest } = event;
  const item = document.createElement("li");
  item.value = seq;
  const when = typeof time === "string" ? time : typeof time === "number" ? new Date(time * 1000).toISOString().slice(11, 19) : "";
  item.textContent = [when, ...Object.values(rest).filter((v) => v !== null && v !== "").map((v) => typeof v === "object" ? JSON.stringify(v) : v)].join(" · ");
  log.append(item);
  while (log.children.length > MOST_LINES) log.firstChild.remove();
}

async function refresh() {
  const answer = await fetch(`/evaluations/${section.dataset.id}/matrix`, { headers: { accept: "text/html" } });
  if (answer.ok) document.getElementById("live").innerHTML = await answer.text();
}

function refreshSoon() {
  if (waiting) return;
  waiting = true;
  setTimeout(() => { waiting = false; refresh(); }, 500);
}

const source = new EventSource(`${api}/events`);
source.onmessage = (message) => { line(JSON.parse(message.data)); if (section.dataset.ended === "no") refreshSoon(); };
source.addEventListener("end", () => {
  source.close();
  if (section.dataset.ended === "no") location.reload(); // once: the page then says that it has ended
});

for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", async () => {
    button.disabled = true;
    const retry = button.dataset.do === "retry";
    const answer = await fetch(retry ? `${api}/retry` : api, { method: retry ? "POST" : "DELETE" });
    if (answer.ok) {
      location.reload();
      return;
    }
    const found = await answer.json();
    problem.textContent = `${found.title}: ${found.detail}`;
    problem.hidden = false;
    button.disabled = false;
  });
}
