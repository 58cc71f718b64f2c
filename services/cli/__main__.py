"""`python -m services.cli`: the `metanerf` command of a checkout that is not installed."""

from services.cli.app import main

main()
