"""The command line: arguments, help, console, progress, signals, and the argument RUN."""
