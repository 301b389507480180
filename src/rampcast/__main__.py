"""`python -m rampcast`: the command line."""

from rampcast.cli import main

if __name__ == "__main__":
    main()
