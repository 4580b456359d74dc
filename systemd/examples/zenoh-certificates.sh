#!/bin/sh
# Creates certificates for a Zenoh router and its clients in this folder, by openssl (3.0 or newer):
#
#   ./zenoh-certificates.sh router.example arm planner screen
#
# The first name is the router's host name; the others are clients in the router's rules (zenoh-router.json5).
# Give ca.pem to all, NAME.pem and NAME.key only to NAME; keep ca.key secret and off the network.
set -eu
umask 077
KEY="-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
[ -e ca.key ] || openssl req -x509 $KEY -keyout ca.key -out ca.pem -days 3650 -subj "/CN=contactd CA"
for NAME; do
    openssl req $KEY -keyout "$NAME.key" -subj "/CN=$NAME" \
        -addext "subjectAltName=DNS:$NAME" -addext "extendedKeyUsage=serverAuth,clientAuth" |
        openssl x509 -req -CA ca.pem -CAkey ca.key -days 825 -copy_extensions copy -out "$NAME.pem"
done
chmod 644 ./*.pem
