"""Published tables and figures, measured anew: `luxmeter reproduce`.

One module for each family of claims; `register` makes a claim known, and every module of this package is found by itself. A claim's
module must be cheap to import: what it renders with is imported inside its functions.
"""

from jobs.claims.bench import Bench
from jobs.claims.model import Answer, Measurement, PublishedClaim, Row, held, row
from jobs.claims.registry import UnknownClaim, get_claim, register, registered_claims

__all__ = [
    "Answer",
    "Bench",
    "Measurement",
    "PublishedClaim",
    "Row",
    "UnknownClaim",
    "get_claim",
    "held",
    "register",
    "registered_claims",
    "row",
]
