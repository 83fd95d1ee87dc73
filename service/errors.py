"""What can go wrong between this program and a service."""

from __future__ import annotations


class ServiceError(RuntimeError):
    """The service can't be reached or can't do what was asked; one line."""
