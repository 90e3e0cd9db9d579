"""The services that set a node's parameters: unknown parameters and missing values are refused.

rclpy's own services raise an error on an unknown type or a missing value, which ends the node, and accept a parameter
without a name.
"""

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService


class RefusingParameterService(ParameterService):
    """`set_parameters` and `set_parameters_atomically`, of which rclpy calls these two methods; the rest is rclpy's."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        response.results = [self._set([given]) for given in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = self._set(request.parameters)
        return response

    def _set(self, given: Sequence[Any]) -> SetParametersResult:
        node = self._get_node()
        unknown = [each.name for each in given if not node.has_parameter(each.name)]
        if unknown:
            return SetParametersResult(successful=False, reason=f"no such parameter: {unknown[0]!r}")
        try:
            return node.set_parameters_atomically([Parameter.from_parameter_msg(each) for each in given])
        except (ParameterException, TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
