"""`python -m invtrack`: the command."""

from invtrack.command import main

if __name__ == "__main__":
    main()
