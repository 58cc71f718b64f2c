"""Many meetings at once: people without browsers, who send and receive what a page would."""
