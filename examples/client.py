"""Submit an evaluation to a running service and follow it to its report: python examples/client.py [ADDRESS]."""

import json
import sys

import httpx

asked = {
    "scenes": ["cornell-box"],
    "methods": [{"name": "ir"}, {"name": "pt", "settings": {"spp": 16}}],
    "size": [160, 90],
    "noise": 0.05,
}
with httpx.Client(base_url=sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000", timeout=60) as service:
    links = service.post("/v1/evaluations", json=asked).raise_for_status().json()["links"]
    with service.stream("GET", links["events"]) as events:
        for line in events.iter_lines():
            print(json.loads(line[6:]) if line.startswith("data: ") else "", end="\n" if line.startswith("data: ") else "")
    print(service.base_url.join(service.get(links["self"]).json()["links"]["report"]))
