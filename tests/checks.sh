# Checks of a suite in shell, to be sourced from it: each counts as a test, and `summary` ends the suite as tests/run reads
# it. $place is a folder that is gone at the end.
passed=0
failed=0
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

verdict() { # STATUS NAME
  if [ "$1" -eq 0 ]; then
    echo "ok: $2"
    passed=$((passed + 1))
  else
    echo "FAILED: $2"
    failed=$((failed + 1))
  fi
}

check() { # NAME COMMAND...: what the command says is shown if it fails
  local name=$1 status
  shift
  "$@" >"$place/log" 2>&1
  status=$?
  [ "$status" -eq 0 ] || cat "$place/log"
  verdict "$status" "$name"
}

summary() {
  echo "$passed passed, $failed failed"
  [ "$failed" -eq 0 ]
}
