"""`python -m photosite`: the command, where its script is not on the path."""

from photosite.cli.main import main

main()
