"""From the channels of a recording to the roles of a joint, in SI and on one grid."""
