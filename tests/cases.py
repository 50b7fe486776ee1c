"""One law, one test: a test over many cases has one name, and says in which case it fails."""

import inspect


def looped(names, cases):
    """Decorator as `pytest.mark.parametrize`, but all cases are one test; fixtures are the same for all."""
    several, all_cases = not isinstance(names, str), list(cases)
    told = names if several else (names,)

    def decorate(test):
        def run(**fixtures):
            for case in all_cases:
                values = dict(zip(told, case if several else (case,), strict=True))
                try:
                    test(**values, **fixtures)
                except Exception as error:
                    error.add_note(f"in the case {values}")
                    raise

        signature = inspect.signature(test)
        left = [one for name, one in signature.parameters.items() if name not in told]
        run.__signature__ = signature.replace(parameters=left)
        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        run.pytestmark = list(getattr(test, "pytestmark", []))
        return run

    return decorate
