"""The native CPU module, where it was built."""
