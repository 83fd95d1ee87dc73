"""The queue's database: one SQLite file (write-ahead log) or PostgreSQL, by URL; and luxmeter's own tables in it."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from jobs.errors import StoreError

WAIT_S = 30.0
IDLE_S = 30.0
META = sa.MetaData()
EVALUATIONS = sa.Table(
    "luxmeter_evaluations", META,
    sa.Column("id", sa.String(80), primary_key=True),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("finished", sa.Float),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("priority", sa.Integer, nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("request", sa.Text, nullable=False),
    sa.Column("order", sa.Text, nullable=False),
    sa.Column("total", sa.Integer, nullable=False),
    sa.Column("events", sa.Integer, nullable=False),
    sa.Column("error", sa.Text),
    sa.Index("luxmeter_evaluations_page", "created", "id"),
    sa.Index("luxmeter_evaluations_state_page", "state", "created", "id"),
)  # fmt: skip
NODES = sa.Table(
    "luxmeter_nodes", META,
    sa.Column("evaluation", sa.String(80), primary_key=True),
    sa.Column("node", sa.String(400), primary_key=True),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("queue", sa.String(16), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("ready", sa.Float),
    sa.Column("ended", sa.Float),
    sa.Column("worker", sa.String(120)),
    sa.Column("method", sa.String(80)),
    sa.Column("failure", sa.String(16)),
    sa.Column("error", sa.Text),
    sa.Column("outcome", sa.Text),
    sa.Column("prepare_s", sa.Float),
    sa.Column("render_s", sa.Float),
    sa.Index("luxmeter_nodes_state", "state", "queue"),
)  # fmt: skip
EVENTS = sa.Table(
    "luxmeter_events", META,
    sa.Column("evaluation", sa.String(80), primary_key=True),
    sa.Column("seq", sa.Integer, primary_key=True),
    sa.Column("event", sa.Text, nullable=False),
)  # fmt: skip
WORKERS = sa.Table(
    "luxmeter_workers", META,
    sa.Column("id", sa.String(120), primary_key=True),
    sa.Column("started", sa.Float, nullable=False),
    sa.Column("seen", sa.Float, nullable=False),
)  # fmt: skip


def open_database(url: str, wait_s: float = WAIT_S, idle_s: float = IDLE_S, flush: bool = True) -> sa.Engine:
    """An engine whose tables exist. Raises StoreError where the database can't be opened or written.

    wait_s: how long a writer waits for another one's lock on an SQLite file; flush: whether that file is flushed to disk at each
    commit, see `WithoutFlush`; idle_s: how long PostgreSQL lets a transaction stand still before it ends it. A process that is
    stopped in the middle of one would hold its locks for ever.
    """
    with readable_errors(url):
        prepare_file(url)
        engine = sa.create_engine(with_driver(url), pool_pre_ping=not is_sqlite(url))
        set_up = _set_up_sqlite(wait_s, flush) if is_sqlite(url) else _set_up_postgres(idle_s)
        sa.event.listen(engine, "connect", set_up)
        with engine.begin() as connection:
            if not is_sqlite(url):  # two processes that create one table at once would both fail
                connection.execute(sa.text("select pg_advisory_xact_lock(7239641)"))
            META.create_all(connection)
        return engine


class WithoutFlush(sqlite3.Connection):
    """A connection for what can be done again: its commits survive the end of any process; a power cut may take the last of them.

    The file is consistent all the same: with a write-ahead log, what is lost is a tail of it. A later commit that is flushed keeps
    all before it. https://www.sqlite.org/pragma.html#pragma_synchronous
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.execute("pragma synchronous=normal")


def prepare_file(url: str) -> None:
    """Create an SQLite file with a write-ahead log: a property of the file, set once, which makes writing several times faster."""
    path = file_of(url)
    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.closing(sqlite3.connect(path, timeout=WAIT_S)) as connection:
        connection.execute("pragma journal_mode=wal")


def is_sqlite(url: str) -> bool:
    """Whether the URL names an SQLite file."""
    return url.startswith("sqlite:")


def file_of(url: str) -> Path | None:
    """The SQLite file of a URL, None for another database."""
    name = sa.engine.make_url(url).database if is_sqlite(url) else None
    return Path(name) if name else None


def with_driver(url: str) -> str:
    """The URL with the driver that is installed for it."""
    for prefix in ("postgresql://", "postgres://"):
        if url.startswith(prefix):
            return f"postgresql+psycopg://{url.removeprefix(prefix)}"
    return url


@contextlib.contextmanager
def readable_errors(url: str) -> Iterator[None]:
    """Turn what the database says of itself into a StoreError of one line."""
    try:
        yield
    except (sa.exc.OperationalError, sqlite3.OperationalError, sa.exc.InternalError) as error:
        cause = getattr(error, "orig", None) or error
        name = sa.engine.make_url(url).render_as_string(hide_password=True)
        raise StoreError(f"can't use the database {name}: {str(cause).strip().splitlines()[0]}") from error
    except OSError as error:
        raise StoreError(f"can't use the database {url}: {error.strerror or error}") from error


def _set_up_sqlite(wait_s: float, flush: bool) -> Callable[[Any, object], None]:
    def set_up(connection: Any, record: object) -> None:
        connection.isolation_level = "IMMEDIATE"
        connection.execute(f"pragma busy_timeout={round(wait_s * 1000)}")
        connection.execute(f"pragma synchronous={'full' if flush else 'normal'}")

    return set_up


def _set_up_postgres(idle_s: float) -> Callable[[Any, object], None]:
    def set_up(connection: Any, record: object) -> None:
        connection.execute(f"set idle_in_transaction_session_timeout = {round(idle_s * 1000)}")
        connection.commit()  # the pool rolls back what comes back to it, and with it an uncommitted setting

    return set_up
