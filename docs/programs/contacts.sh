#!/bin/sh
# Contacts of the arm, one line each: contacts.sh [VIEW_SOCKET]
set -eu
contactctl --socket "${1:-/run/contactd/contactd-view.sock}" watch --json |
  jq --unbuffered -r '.time_s as $t | .notices[].contact | values | "\($t) \(.joint) \(.torque) \(.level)"'
