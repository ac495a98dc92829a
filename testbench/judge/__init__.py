"""The paper's numbers and the one judge of them: numbers with uncertainty, declared roles, one verdict function.

Source    docs/paper.md
"""
