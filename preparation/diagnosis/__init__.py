"""Diagnosis of a preparation: measured figures, findings and a verdict."""
