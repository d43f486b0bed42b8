#!/usr/bin/env bash
# skl2onnx 1.20.0: a neural network for regression with two targets (scikit-learn's MLPRegressor)
# becomes a graph whose output has one column and twice the rows. The converter ends it with a
# Reshape to (-1, 1), whatever the number of targets: the two targets of a row lie below each
# other. Nothing is reported at the conversion.
#
# Guess before running: the output has the shape of `predict`, (rows, 2), as with
# LinearRegression of two targets.
# Seen: (2 * rows, 1), interleaved. A reader that takes the first column as the first target
# pairs the targets of two different rows.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv python > /dev/null
python/bin/pip install --quiet --disable-pip-version-check \
    skl2onnx==1.20.0 scikit-learn==1.9.1 onnx==1.23.2 onnxruntime==1.32.0
cat > targets.py <<'PYTHON'
import numpy as np
import onnxruntime
from skl2onnx import to_onnx
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPRegressor

rng = np.random.default_rng(1)
x = rng.normal(size=(64, 3)).astype(np.float32)
y = np.column_stack([x @ [1.0, 2.0, 3.0], 100 + x[:, 0]])
for model in [LinearRegression(), MLPRegressor(hidden_layer_sizes=(8,), max_iter=300, random_state=1)]:
    model.fit(x, y)
    graph = to_onnx(model, x[:1])
    session = onnxruntime.InferenceSession(graph.SerializeToString())
    [found] = session.run(None, {session.get_inputs()[0].name: x[:5]})
    wanted = model.predict(x[:5])
    same = found.shape == wanted.shape and np.allclose(found, wanted, atol=1e-3)
    interleaved = found.shape == (10, 1) and np.allclose(found.reshape(5, 2), wanted, atol=1e-3)
    print(type(model).__name__, wanted.shape, found.shape, "same" if same else "interleaved" if interleaved else "other")
PYTHON
python/bin/python -W ignore targets.py | tee seen
diff seen - <<'SEEN'
LinearRegression (5, 2) (5, 2) same
MLPRegressor (5, 2) (10, 1) interleaved
SEEN
echo "skl2onnx 1.20.0: as described"
