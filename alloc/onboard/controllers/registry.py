"""All readhesion controllers by name: built-in ones, those of installed packages, and those registered at run time."""

from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import BuiltInController
from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import HostedController
from alloc.registry import Registry

CONTROLLERS: Registry[type[BuiltInController] | HostedController] = Registry(
    "controller", "readhesion.controllers", OnboardError
)
"""Built-in controllers first, starting with the simplest; each registered or installed one is a `HostedController`."""

for _name, _controller in BUILT_IN.items():
    CONTROLLERS.register(_name, _controller)
