"""Jobs on the machines of a Ray cluster; Ray is imported only where it is asked for."""
