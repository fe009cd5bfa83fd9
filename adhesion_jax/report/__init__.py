"""Tables, figures and sentences; no result is computed here."""
