"""Tables, sentences and charts of the pages, made from docs/figures."""
