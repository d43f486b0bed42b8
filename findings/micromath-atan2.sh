#!/usr/bin/env bash
# micromath 2.1.0: `F32Ext::atan2` is documented to return 0 for (0, 0) and an error of at
# most 0.002 rad elsewhere. It returns NaN for (0, 0), and also for every pair of finite
# coordinates whose squares both vanish or overflow in f32: a vector of length 1e-25 has no
# angle, nor has one of 1e20.
#
# Guess before running: (0, 0) gives 0, as the documentation lists; tiny and huge vectors
# give the angle of the same direction, as in libm.
# Seen: NaN in all of these. A control law that takes an angle by it returns NaN for a mass
# right over its foot.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
cargo init --quiet --name atan2 --vcs none .
cargo add --quiet micromath@=2.1.0
cat > src/main.rs <<'RUST'
use micromath::F32Ext;

fn main() {
    for (y, x) in [(0.0_f32, 0.0_f32), (1e-25, 1e-25), (1e-25, -1e-25), (1e20, 1e20), (3.0, 2.0)] {
        println!("{y:e} {x:e} micromath {:.3} std {:.3}", F32Ext::atan2(y, x), f32::atan2(y, x));
    }
}
RUST
cargo run --quiet | tee seen
diff seen - <<'SEEN'
0e0 0e0 micromath NaN std 0.000
1e-25 1e-25 micromath NaN std 0.785
1e-25 -1e-25 micromath NaN std 2.356
1e20 1e20 micromath NaN std 0.785
3e0 2e0 micromath 0.980 std 0.983
SEEN
echo "micromath 2.1.0: as described"
