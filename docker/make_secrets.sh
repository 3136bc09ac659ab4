#!/bin/sh
# Makes every secret that compose.yaml mounts, each its own, into docker/secrets; keeps those that are there.
#
#   sh docker/make_secrets.sh [FOLDER]
#
# The folder is its owner's alone. The files in it can be read by all, because a container's user, who is another one,
# must: nobody else gets as far as the files.
set -eu
folder=${1:-$(dirname "$0")/secrets}
umask 077
mkdir -p "$folder"
chmod 700 "$folder"

random() { head -c 32 /dev/urandom | base64 | tr '+/' '-_' | tr -d '=\n'; }
write() { # NAME: standard input
  if [ -e "$folder/$1" ]; then
    cat >/dev/null
    echo "kept  $folder/$1"
  else
    cat >"$folder/.$1"
    chmod 444 "$folder/.$1"
    mv "$folder/.$1" "$folder/$1"
    echo "wrote $folder/$1"
  fi
}
value() { cat "$folder/$1"; }

random | write metrics_token
write tokens <<TOKENS
# NAME TOKEN [+SCOPE ...] [SCENE ...]: docs/how-to/tokens.md. Read again when it changes.
headsets $(random)
prometheus $(value metrics_token) +metrics
TOKENS
write token_keys <<KEYS
# ID ALGORITHM KEY, the first one signs: terraport token create --keys docker/secrets/token_keys ...
first HS256 $(random)
KEYS
random | write grafana_admin
random | write alert_token
random | write s3_reader
random | write s3_writer
write s3_identities <<S3
{"identities": [
  {"name": "reader", "actions": ["Read", "List"],
   "credentials": [{"accessKey": "terraport-reader", "secretKey": "$(value s3_reader)"}]},
  {"name": "writer", "actions": ["Read", "List", "Write", "Tagging"],
   "credentials": [{"accessKey": "terraport-writer", "secretKey": "$(value s3_writer)"}]}
]}
S3
