#!/usr/bin/env bash
# prost 0.14.6: a proto3 `float` or `double` of -0.0 is not written, and so read back as
# +0.0: the sign is lost. The protobuf specification says that -0.0 is not the default
# value and must be written, and protobuf for Python writes it.
#
# Guess before running: a plain proto3 `float` field keeps every bit of every value.
# Seen: prost compares with `!= 0.0`, for which -0.0 is 0: no byte is written. NaN and its
# payload survive. `#[prost(required)]` on the field writes it always. In a recording that
# is compared bit for bit, this shows only when a velocity passes through -0.0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

cargo init --quiet --name negative-zero --vcs none .
cargo add --quiet prost@=0.14.6
cat > src/main.rs <<'RUST'
use prost::Message;

#[derive(Clone, PartialEq, Message)]
struct Plain {
    #[prost(float, tag = "1")]
    value: f32,
}

#[derive(Clone, PartialEq, Message)]
struct Always {
    #[prost(float, required, tag = "1")]
    value: f32,
}

fn main() {
    let plain = Plain { value: -0.0 }.encode_to_vec();
    let back = Plain::decode(plain.as_slice()).unwrap().value;
    println!("prost, plain: {plain:02x?}, read back {back:?}");
    println!("prost, required: {:02x?}", Always { value: -0.0 }.encode_to_vec());
}
RUST
cargo run --quiet | tee seen

python3 -m venv python > /dev/null
python/bin/pip install --quiet protobuf==6.33.0
cat > wrapped.py <<'PYTHON'
from google.protobuf.wrappers_pb2 import FloatValue

# A message whose only field is `float value = 1`.
print("Python protobuf:", FloatValue(value=-0.0).SerializeToString().hex(" "))
PYTHON
python/bin/python wrapped.py | tee -a seen

diff seen - <<'SEEN'
prost, plain: [], read back 0.0
prost, required: [0d, 00, 00, 00, 80]
Python protobuf: 0d 00 00 00 80
SEEN
echo "prost 0.14.6: as described"
