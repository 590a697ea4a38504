"""Jobs: work in processes of its own, on this machine or on those of a cluster."""
