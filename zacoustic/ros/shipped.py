"""Common definitions that `rosbags` lacks: services, actions, and the messages of geographic_msgs.

The services and actions are from the packages `action_msgs`, `example_interfaces`,
`geographic_msgs`, `lifecycle_msgs`, `nav_msgs`, `rcl_interfaces`, `std_srvs` and
`type_description_interfaces`, and the same in all distributions that have them. Put others in a
folder of definitions that the configuration names.
"""

from typing import Final

_UUID: Final = "unique_identifier_msgs/UUID"

MESSAGES: Final = {
    "geographic_msgs/msg/BoundingBox": "GeoPoint min_pt\nGeoPoint max_pt",
    "geographic_msgs/msg/GeoPath": "std_msgs/Header header\nGeoPoseStamped[] poses",
    "geographic_msgs/msg/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude",
    "geographic_msgs/msg/GeoPointStamped": "std_msgs/Header header\nGeoPoint position",
    "geographic_msgs/msg/GeoPose": "GeoPoint position\ngeometry_msgs/Quaternion orientation",
    "geographic_msgs/msg/GeoPoseStamped": "std_msgs/Header header\nGeoPose pose",
    "geographic_msgs/msg/GeoPoseWithCovariance": "GeoPose pose\nfloat64[36] covariance",
    "geographic_msgs/msg/GeoPoseWithCovarianceStamped": (
        "std_msgs/Header header\nGeoPoseWithCovariance pose"
    ),
    "geographic_msgs/msg/GeographicMap": (
        f"std_msgs/Header header\n{_UUID} id\nBoundingBox bounds\nWayPoint[] points\n"
        "MapFeature[] features\nKeyValue[] props"
    ),
    "geographic_msgs/msg/GeographicMapChanges": (
        f"std_msgs/Header header\nGeographicMap diffs\n{_UUID}[] deletes"
    ),
    "geographic_msgs/msg/KeyValue": "string key\nstring value",
    "geographic_msgs/msg/MapFeature": f"{_UUID} id\n{_UUID}[] components\nKeyValue[] props",
    "geographic_msgs/msg/RouteNetwork": (
        f"std_msgs/Header header\n{_UUID} id\nBoundingBox bounds\nWayPoint[] points\n"
        "RouteSegment[] segments\nKeyValue[] props"
    ),
    "geographic_msgs/msg/RoutePath": (
        f"std_msgs/Header header\n{_UUID} network\n{_UUID}[] segments\nKeyValue[] props"
    ),
    "geographic_msgs/msg/RouteSegment": (
        f"{_UUID} id\n{_UUID} start\n{_UUID} end\nKeyValue[] props"
    ),
    "geographic_msgs/msg/WayPoint": f"{_UUID} id\nGeoPoint position\nKeyValue[] props",
}
"""Name of each message, with its members."""

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
    "geographic_msgs/srv/GetGeoPath": (
        "",
        "GeoPoint start\nGeoPoint goal",
        f"bool success\nstring status\nGeoPath plan\n{_UUID} network\n{_UUID} start_seg\n"
        f"{_UUID} goal_seg\nfloat64 distance",
    ),
    "geographic_msgs/srv/GetGeographicMap": (
        "",
        "string url\nBoundingBox bounds",
        "bool success\nstring status\nGeographicMap map",
    ),
    "geographic_msgs/srv/GetRoutePlan": (
        "",
        f"{_UUID} network\n{_UUID} start\n{_UUID} goal",
        "bool success\nstring status\nRoutePath plan",
    ),
    "geographic_msgs/srv/UpdateGeographicMap": (
        "",
        "GeographicMapChanges updates",
        "bool success\nstring status",
    ),
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
    "type_description_interfaces/srv/GetTypeDescription": (
        "",
        "string type_name\nstring type_hash\nbool include_type_sources true",
        "bool successful\nstring failure_reason\nTypeDescription type_description\n"
        "TypeSource[] type_sources\nKeyValue[] extra_information",
    ),
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
    texts |= MESSAGES
    texts["service_msgs/msg/ServiceEventInfo"] = EVENT_INFO
    return texts
