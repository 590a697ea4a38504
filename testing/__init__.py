"""The conformance kit: what gsfw expects of the parts of plugins, as functions and tests."""
