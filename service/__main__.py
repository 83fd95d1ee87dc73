"""`python -m service` is `luxmeter`."""

from service.cli import main

main()
