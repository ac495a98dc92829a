"""Study of word lengths: closed form, runs beside it, cost, page.  Source: docs/word_lengths.md"""
