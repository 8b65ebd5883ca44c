"""Look-up of the methods that a base class only names: a compiled one cannot ask for them as an abstract class does."""


def only_named(base: type) -> set[str]:
    """Return the methods and properties of a class that raise NotImplementedError."""
    functions = {name: getattr(each, "fget", each) for name, each in vars(base).items()}
    written = {name: each.__code__ for name, each in functions.items() if hasattr(each, "__code__")}
    return {name for name, code in written.items() if "NotImplementedError" in code.co_names}
