"""Inputs as an unlucky, a careless and a hostile user would give them, and how each may end.

    case = data.draw(CASES["recording"])       # a Case: files, and what is done with them
    broken = outcome(case, folder)             # None, or what was wrong with how it ended

Every case ends with a result, or with one line that names the place and the remedy: nothing else.
The tests draw a few hundred of them, `python -m benchmarks fuzz` ten thousand.
"""
