"""What nodes on rmw_zenoh were seen to say: tokens, keys, payloads and attachments."""

from typing import Final

TWIST_HASH: Final = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
STRING_HASH: Final = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ADD_HASH: Final = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"

NODE_TOKEN: Final = "@ros2_lv/0/2dcf8fcb480dbe6b1a9d54957ccd6595/0/0/NN/%/%/talker"
PUBLISHER_TOKEN: Final = (
    "@ros2_lv/0/2dcf8fcb480dbe6b1a9d54957ccd6595/0/0/MP/%/%/talker/%chatter/"
    f"std_msgs::msg::dds_::String_/{STRING_HASH}/::,10:,:,:,,"
)
LATCHED_TOKEN: Final = (
    "@ros2_lv/0/2dcf8fcb480dbe6b1a9d54957ccd6595/1/1/MP/%/%robot1/ctl/%robot1%cmd_vel/"
    f"geometry_msgs::msg::dds_::Twist_/{TWIST_HASH}/2:1:,1:,:,:,,"
)
SERVER_TOKEN: Final = (
    "@ros2_lv/0/da4578732e03bfc739af87033392bec/2/2/SS/%/%/adder/%add_two_ints/"
    f"example_interfaces::srv::dds_::AddTwoInts_/{ADD_HASH}/::,10:,:,:,,"
)
CLIENT_TOKEN: Final = (
    "@ros2_lv/0/2dcf8fcb480dbe6b1a9d54957ccd6595/2/2/SC/%/%/caller/%add_two_ints/"
    f"example_interfaces::srv::dds_::AddTwoInts_/{ADD_HASH}/::,10:,:,:,,"
)
TOKENS: Final = (NODE_TOKEN, PUBLISHER_TOKEN, LATCHED_TOKEN, SERVER_TOKEN, CLIENT_TOKEN)

STRING_KEY: Final = f"0/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
STRING_PAYLOAD: Final = bytes.fromhex("000100000600000068656c6c6f00")
STRING_ATTACHMENT: Final = bytes.fromhex(
    "000000000000000000ee575a68dce918106039c669c67c4ec9bfd8241446a6869e"
)
TWIST_KEY: Final = f"0/robot1/cmd_vel/geometry_msgs::msg::dds_::Twist_/{TWIST_HASH}"
TWIST_PAYLOAD: Final = bytes.fromhex("00010000" + "000000000000f03f" + 40 * "00")
ADD_KEY: Final = f"0/add_two_ints/example_interfaces::srv::dds_::AddTwoInts_/{ADD_HASH}"
ADD_REQUEST: Final = bytes.fromhex("0001000002000000000000000300000000000000")
ADD_ATTACHMENT: Final = bytes.fromhex(
    "0100000000000000001db37a68dce918100421d488e49f4a81b7da0c4e348cc877"
)

PUBLISHED_HASHES: Final = {
    "geometry_msgs/msg/Twist": "9c45bf16",
    "std_msgs/msg/String": "df668c74",
    "example_interfaces/srv/AddTwoInts": "e118de6b",
    "std_srvs/srv/Trigger": "eeff2cd6",
    "std_srvs/srv/SetBool": "abe9e4bb",
    "action_msgs/srv/CancelGoal": "573d8b0a",
    "action_msgs/msg/GoalStatusArray": "6c1684b0",
    "example_interfaces/action/Fibonacci_SendGoal": "d1a57fb2",
    "example_interfaces/action/Fibonacci_GetResult": "1b0de0d5",
    "example_interfaces/action/Fibonacci_FeedbackMessage": "c1de71af",
    "geographic_msgs/msg/MapFeature": "925101fc",
    "geographic_msgs/msg/RouteNetwork": "a5954521",
    "geographic_msgs/msg/RoutePath": "e4b22c83",
    "geographic_msgs/srv/GetRoutePlan": "1c08a731",
    "type_description_interfaces/srv/GetTypeDescription": "69b9c19c",
}
"""The first digits of what ROS 2 itself says."""
