"""Scenes, captures, fakes and runs that several tests share."""
