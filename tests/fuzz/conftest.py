"""What is not collected."""

collect_ignore = ["with_atheris.py"]  # an optional job, with a package of its own
