"""The moves of the search, one a file: each turns a hypothesis (a `View`) into another, or not.

====================  ==========================================================================
`add`                 the candidate that gains most beyond its penalty and passes the gates
`add_pair`            warm-up and temperature, which take each other's place when fitted alone
`add_bundle`          several slow effects that pass together though none passes alone
`refit`               every effect estimated again given the others
`drop`                effects that later ones have made superfluous
`fold_sidebands`      a carrier and its sidebands become the one modulated tone that they are
`replace_drift`       slow effects that are pieces of a drift without a name become `unexplained`
====================  ==========================================================================
"""
