"""Prometheus metrics: what the queue tells, and what this process has answered."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

from service.http.queue import Queue


class QueueCollector(Collector):
    """Asks the queue for its figures whenever they are scraped."""

    def __init__(self, queue: Queue) -> None:
        self.queue = queue

    def describe(self) -> list[Metric]:
        """Nothing in advance: the queue is not asked before the first scrape."""
        return []

    def collect(self) -> Iterator[Metric]:
        """Depth, age of the oldest, seconds by method and stage, failures by kind, determinism failures."""
        stats = self.queue.stats()
        depth = GaugeMetricFamily("luxmeter_queue_depth", "Pieces of work by queue and state.", labels=("queue", "state"))
        oldest = GaugeMetricFamily("luxmeter_queue_oldest_seconds", "Age of the oldest queued piece of work.", labels=("queue",))
        for name, figures in stats["queues"].items():
            for state in ("queued", "running"):
                depth.add_metric((name, state), figures[state])
            oldest.add_metric((name,), figures["oldest_s"] or 0.0)
        failures = CounterMetricFamily("luxmeter_failures", "Failed pieces of work by kind.", labels=("kind",))
        for kind, count in stats["failures"].items():
            failures.add_metric((kind,), count)
        seconds = CounterMetricFamily("luxmeter_method_seconds", "Wall seconds by method and stage.", labels=("method", "stage"))
        for method, stages in stats["seconds"].items():
            for stage, value in stages.items():
                seconds.add_metric((method, stage), value)
        clashes = GaugeMetricFamily(
            "luxmeter_determinism_failures", "Equal questions that got different answers.", value=stats["clashes"]
        )
        yield from (depth, oldest, failures, seconds, clashes)


class Metrics:
    """The registry of one service, and the counters of its own requests."""

    def __init__(self, queue: Queue) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "luxmeter_http_requests", "Answered requests.", ("method", "route", "status"), registry=self.registry
        )
        self.latency = Histogram("luxmeter_http_seconds", "Time to answer.", ("route",), registry=self.registry)
        self.registry.register(QueueCollector(queue))

    def answered(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count one answer. `route` is the pattern, not the address, so that there are few of them."""
        self.requests.labels(method, route, str(status)).inc()
        self.latency.labels(route).observe(seconds)
