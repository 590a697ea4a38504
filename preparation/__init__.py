"""From photos or video to a data set: frames, features, matches, camera poses, and why not."""
