#!/bin/sh
# Certificates for a Zenoh router and those who reach it, by openssl (3.0 or newer), into this folder:
#
#   ./zenoh-certificates.sh router.example arm planner screen
#
# The first name is the router's host name; each other is whom the router's rules know (zenoh-router.json5).
# ca.pem goes to everybody, NAME.pem and NAME.key to NAME alone, ca.key to nobody: keep it off the network.
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
