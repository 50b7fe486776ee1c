"""All readhesion controllers by name: those that are built in, those of installed packages, those registered at run time."""

from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import BuiltInController
from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import HostedController
from alloc.registry import Registry

CONTROLLERS: Registry[type[BuiltInController] | HostedController] = Registry(
    "controller", "readhesion.controllers", OnboardError
)
"""Built-in controllers first, from the simplest on; those registered or installed are each a `HostedController`."""

for _name, _controller in BUILT_IN.items():
    CONTROLLERS.register(_name, _controller)
