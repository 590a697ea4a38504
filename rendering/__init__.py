"""Films of a trained model: camera paths over time, trails of Gaussians, image and video files."""
