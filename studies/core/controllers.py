"""What a study asks of readhesion controllers: whether they can be had, and whether they live in Python."""

from alloc.errors import OnboardError
from alloc.onboard.host import CONTROLLERS, HostedController
from studies.files.study_error import StudyError


def check_controller(name: str) -> None:
    """Raise `StudyError` where there is no controller of this name, or it needs what is not installed."""
    try:
        CONTROLLERS.find(name)
    except OnboardError as error:
        raise StudyError(str(error)) from None
    except (ImportError, AttributeError) as error:
        raise StudyError(
            f"controller {name!r} needs something that is not installed ({error}); "
            "run `make setup`, or leave it out with --controllers"
        ) from None


def is_hosted(name: str) -> bool:
    """Whether a controller runs in Python, which is slow."""
    return isinstance(CONTROLLERS.get(name), HostedController)
