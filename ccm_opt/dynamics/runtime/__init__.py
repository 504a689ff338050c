"""What evaluates the dynamics: one function with two back ends, the compiled library and CasADi's virtual machine."""
