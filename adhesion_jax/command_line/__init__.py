"""The command line: options, help and refusals; what a command does is imported when it runs."""
