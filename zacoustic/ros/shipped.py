"""Common services and actions, which `rosbags` lacks: it has messages only.

They are from the packages `action_msgs`, `example_interfaces`, `lifecycle_msgs`, `nav_msgs`,
`rcl_interfaces` and `std_srvs`, and the same in all distributions since Humble. Put others in a
folder of definitions that the configuration names.
"""

from typing import Final

SERVICES: Final = {
    "action_msgs/srv/CancelGoal": (
        "int8 ERROR_NONE=0\nint8 ERROR_REJECTED=1\nint8 ERROR_UNKNOWN_GOAL_ID=2\n"
        "int8 ERROR_GOAL_TERMINATED=3\n",
        "GoalInfo goal_info",
        "int8 return_code\nGoalInfo[] goals_canceling",
    ),
    "example_interfaces/srv/AddTwoInts": ("", "int64 a\nint64 b", "int64 sum"),
    "example_interfaces/srv/SetBool": ("", "bool data", "bool success\nstring message"),
    "example_interfaces/srv/Trigger": ("", "", "bool success\nstring message"),
    "lifecycle_msgs/srv/ChangeState": ("", "Transition transition", "bool success"),
    "lifecycle_msgs/srv/GetAvailableStates": ("", "", "State[] available_states"),
    "lifecycle_msgs/srv/GetAvailableTransitions": (
        "",
        "",
        "TransitionDescription[] available_transitions",
    ),
    "lifecycle_msgs/srv/GetState": ("", "", "State current_state"),
    "nav_msgs/srv/GetMap": ("", "", "OccupancyGrid map"),
    "nav_msgs/srv/GetPlan": (
        "",
        "geometry_msgs/PoseStamped start\ngeometry_msgs/PoseStamped goal\nfloat32 tolerance",
        "Path plan",
    ),
    "rcl_interfaces/srv/DescribeParameters": (
        "",
        "string[] names",
        "ParameterDescriptor[] descriptors",
    ),
    "rcl_interfaces/srv/GetParameterTypes": ("", "string[] names", "uint8[] types"),
    "rcl_interfaces/srv/GetParameters": ("", "string[] names", "ParameterValue[] values"),
    "rcl_interfaces/srv/ListParameters": (
        "",
        "string[] prefixes\nuint64 depth",
        "ListParametersResult result",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "",
        "Parameter[] parameters",
        "SetParametersResult[] results",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "",
        "Parameter[] parameters",
        "SetParametersResult result",
    ),
    "std_srvs/srv/Empty": ("", "", ""),
    "std_srvs/srv/SetBool": ("", "bool data", "bool success\nstring message"),
    "std_srvs/srv/Trigger": ("", "", "bool success\nstring message"),
}
"""Name of each service, with its constants, request and response."""

ACTIONS: Final = {
    "action_tutorials_interfaces/action/Fibonacci": (
        "int32 order",
        "int32[] sequence",
        "int32[] partial_sequence",
    ),
    "example_interfaces/action/Fibonacci": (
        "int32 order",
        "int32[] sequence",
        "int32[] sequence",
    ),
}
"""Name of each action, with its goal, result and feedback."""

EVENT_INFO: Final = (
    "uint8 REQUEST_SENT=0\nuint8 REQUEST_RECEIVED=1\nuint8 RESPONSE_SENT=2\n"
    "uint8 RESPONSE_RECEIVED=3\nuint8 event_type\nbuiltin_interfaces/Time stamp\n"
    "char[16] client_gid\nint64 sequence_number"
)
"""``service_msgs/msg/ServiceEventInfo``, which Humble does not have yet."""


def shipped() -> dict[str, str]:
    """Return the text of each definition, as in a file."""
    texts = {
        name: f"{constants}{request}\n---\n{response}\n"
        for name, (constants, request, response) in SERVICES.items()
    }
    texts |= {name: "\n---\n".join(parts) for name, parts in ACTIONS.items()}
    texts["service_msgs/msg/ServiceEventInfo"] = EVENT_INFO
    return texts
