#!/bin/sh
# Runs coturn with its secret and the proxy's certificate, which is there a while after the proxy's first start,
# and is replaced every two months.
umask 077

# in a file, since everybody on this machine may read a command line
{
  cat /etc/coturn/turnserver.conf
  printf 'static-auth-secret=%s\n' "$(cat /run/secrets/turn_secret)"
} > /tmp/turnserver.conf

# Fails where there is none, or none but what we have. Of several authorities' the newest is taken.
take_certificate() {
  found=$(ls -t /proxy/caddy/certificates/*/"$DOMAIN/$DOMAIN.crt" 2> /dev/null | head -n 1)
  [ -n "$found" ] || return 1
  cmp -s "$found" /tmp/turn.crt && cmp -s "${found%.crt}.key" /tmp/turn.key && return 1
  cp "$found" /tmp/turn.crt && cp "${found%.crt}.key" /tmp/turn.key
}

take_certificate
tls=$([ -e /tmp/turn.crt ] && echo yes)
# without one it serves all but TLS
turnserver -c /tmp/turnserver.conf --cert=/tmp/turn.crt --pkey=/tmp/turn.key --userdb=/tmp/turndb \
  --pidfile=/tmp/turnserver.pid &
relay=$!
trap 'kill $relay; wait $relay; exit' INT TERM
while kill -0 $relay 2> /dev/null; do
  # a signal interrupts `wait` alone
  sleep 10 &
  wait $!
  take_certificate || continue
  if [ -n "$tls" ]; then
    kill -USR2 $relay # it reads the files again, and goes on relaying
  else
    kill $relay
    wait $relay
    exec /bin/sh "$0"
  fi
done
wait $relay
