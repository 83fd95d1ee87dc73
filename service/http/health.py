"""Whether this service can do its work: store, queue, OpenGL and Mitsuba."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from pydantic import BaseModel

from jobs.doctor import Check, check_all
from jobs.store import Store
from service.http.queue import Queue
from service.http.settings import ServerSettings

log = logging.getLogger("luxmeter.health")


class Condition(BaseModel):
    """One thing that has to work, what was found, and what to do where it does not."""

    name: str
    ok: bool
    found: str
    fix: str = ""


class Readiness(BaseModel):
    """Ready when every condition holds; `checking` while the machine's first check is under way."""

    ready: bool
    checking: bool
    conditions: list[Condition]


class Health:
    """Store and queue are tried at every question; the machine is checked in child processes, in the background, now and then."""

    def __init__(self, queue: Queue, settings: ServerSettings, machine: Callable[[], Sequence[Check]] = check_all) -> None:
        self.queue, self.settings, self.machine = queue, settings, machine
        self._lock = threading.Lock()
        self._found: list[Condition] | None = None
        self._at = 0.0
        self._checking = False

    def readiness(self) -> Readiness:
        """What is known now; starts a check of the machine where the last one is old."""
        self.refresh()
        found = [_condition("store", self._store), _condition("queue", self._queue)]
        machine = self._found
        found += machine or []
        return Readiness(ready=machine is not None and all(c.ok for c in found), checking=machine is None, conditions=found)

    def refresh(self) -> None:
        """Start a check of the machine in the background where there is none of late."""
        with self._lock:
            if self._checking or (self._found is not None and time.monotonic() - self._at < self.settings.probe_every_s):
                return
            self._checking = True
        threading.Thread(target=self._check, name="health", daemon=True).start()

    def _check(self) -> None:
        try:
            checks = self.machine()
            self._found = [Condition(name=c.name, ok=c.ok, found=c.found, fix="" if c.ok else c.fix) for c in checks if c.required]
        except Exception as error:  # the thread's edge: what stops the check is what is wrong with the machine
            log.exception("the machine can't be checked")
            self._found = [Condition(name="machine", ok=False, found=str(error), fix="luxmeter doctor")]
        with self._lock:
            self._at, self._checking = time.monotonic(), False

    def _store(self) -> str:
        Store(self.settings.home).check_writable()
        return "writable"

    def _queue(self) -> str:
        self.queue.stats()
        return "reachable"


def _condition(name: str, action: Callable[[], str]) -> Condition:
    """Try one thing; whatever it raises is what was found."""
    try:
        return Condition(name=name, ok=True, found=action())
    except Exception as error:
        log.exception("%s is not ready", name)
        return Condition(name=name, ok=False, found=type(error).__name__)
