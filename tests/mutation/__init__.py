"""Are the tests worth anything? Small mistakes are put into the package, and the tests have to find them."""
