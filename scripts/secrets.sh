#!/usr/bin/env bash
# Makes what docker-compose.yml needs and no repository may hold: a file for each secret, and .env, in
# which you say what is yours. Run again it makes only what is missing.
#   scripts/secrets.sh [FOLDER]     FOLDER: where to, instead of this repository
set -euo pipefail
cd "${1:-$(dirname "$0")/..}"

# readable inside the containers, whose users are no users of this machine; the folder keeps others out
umask 022
mkdir -p secrets
chmod 700 secrets

secret() {
  [ -s "secrets/$1" ] || printf %s "$2" > "secrets/$1"
}

secret jwt_secret "$(openssl rand -base64 48)"
# one a line: the previous ones, and the next; empty until the first is to be replaced
secret jwt_other_secrets ""
secret postgres_password "$(openssl rand -hex 24)"
secret s3_secret "$(openssl rand -hex 24)"
secret turn_secret "$(openssl rand -hex 24)"
secret grafana_password "$(openssl rand -hex 12)"
# the provider's own, by which people log in; empty without one
secret oidc_client_secret ""
secret database_url "postgresql+psycopg://metanerf:$(cat secrets/postgres_password)@postgres:5432/metanerf"

[ -e .env ] || cat > .env <<'DOTENV'
# The name under which browsers reach this machine. A public name gets a public certificate by itself;
# localhost gets one of an authority of its own, which browsers warn of. gateway-0.DOMAIN and gateway-1.DOMAIN
# must lead here, too: a meeting lives on one of two gateways.
DOMAIN=localhost
# Whether anybody may be a guest; otherwise only who has a token.
OPEN_ACCESS=true
# How many viewers a gateway takes at once: docs/operate.md says how to find what yours can.
MAX_VIEWERS=36
# The OpenID provider by which people log in, and what it calls this server; its secret is secrets/oidc_client_secret.
OIDC_ISSUER=
OIDC_CLIENT_ID=
# Where traces go; with the profile observe, http://jaeger:4318.
OTLP_ENDPOINT=
# cpu or gpu: where models are trained. Add ",observe" for Prometheus, Grafana and Jaeger.
COMPOSE_PROFILES=cpu
DOTENV
echo "secrets and .env are in $PWD"
