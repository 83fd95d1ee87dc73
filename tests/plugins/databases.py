"""Databases for tests: a fresh SQLite file, or a fresh database of a PostgreSQL that lives as long as the test session."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

BINARIES = ("/usr/lib/postgresql/17/bin", "/usr/lib/postgresql/16/bin", "/usr/lib/postgresql/15/bin")


class NoPostgres(RuntimeError):
    """Why PostgreSQL can't be started here."""


@contextmanager
def postgres() -> Iterator[str]:
    """A temporary PostgreSQL; yields its URL without a database's name. Raises NoPostgres with the reason where there is none."""
    folder = next((Path(path) for path in BINARIES if Path(path, "initdb").is_file()), None)
    if folder is None:
        raise NoPostgres("PostgreSQL is not installed (apt-get install postgresql)")
    user = _user()
    data = Path(tempfile.mkdtemp(prefix="luxmeter-pg-", dir=_roomy_memory()))
    try:
        if user is not None:
            shutil.chown(data, user)
        as_user = [] if user is None else ["runuser", "-u", user, "--"]
        port = _free_port()
        _run(
            [*as_user, str(folder / "initdb"), "-D", str(data / "db"), "-U", "luxmeter", "--auth=trust", "--no-sync", "-E", "UTF8"]
        )
        options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={data} -c fsync=off"
        control = [*as_user, str(folder / "pg_ctl"), "-D", str(data / "db"), "-w", "-t", "60"]
        _run([*control, "-l", str(data / "log"), "-o", options, "start"])
        try:
            yield f"postgresql://luxmeter@127.0.0.1:{port}"
        finally:
            _run([*control, "-m", "immediate", "stop"])
    finally:
        shutil.rmtree(data, ignore_errors=True)


def create_tables(url: str) -> None:
    """Create the queue's tables."""
    from jobs.queue import JobQueue

    JobQueue(url).close()


def template(path: Path) -> Path:
    """A new SQLite file with the queue's tables."""
    create_tables(f"sqlite:///{path}")
    return path


def new_file(source: Path, path: Path) -> str:
    """URL of a copy of an SQLite file that nobody has open."""
    shutil.copyfile(source, path)
    return f"sqlite:///{path}"


def new_database(server: str) -> str:
    """URL of a new database with the queue's tables and nothing in them."""
    import psycopg

    name = f"t{uuid.uuid4().hex[:12]}"
    with psycopg.connect(f"{server}/template1", autocommit=True) as connection:
        connection.execute(f"create database {name} template postgres".encode())
    return f"{server}/{name}"


def _roomy_memory() -> str | None:
    """A folder in memory with room for the databases of a session, None where there is none: thousands of files are gone at once
    there, which takes half a minute on a disk that discards what is deleted."""
    folder = Path("/dev/shm")
    return str(folder) if folder.is_dir() and os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > 2**31 else None


def _user() -> str | None:
    """PostgreSQL refuses to run as root: who it runs as instead."""
    if os.geteuid() != 0:
        return None
    try:
        return pwd.getpwnam("postgres").pw_name
    except KeyError:
        raise NoPostgres("PostgreSQL won't run as root and there is no user postgres") from None


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _run(command: list[str]) -> None:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, cwd="/")
    if done.returncode != 0:
        raise NoPostgres(f"{' '.join(command)}: {done.stdout.strip()[-400:]}")
