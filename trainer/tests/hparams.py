"""Prints what TensorBoard's plugin HParams lists of the trainings below a folder, as JSON.

    python hparams.py DIR

For each run: its parameters, its status, and its metrics at their last step. Also reads every run
by TensorBoard's own reader, and ends with status 1 when a step of a value comes twice.
"""

import json
import sys

from tensorboard import context
from tensorboard.backend.event_processing import data_provider, event_accumulator
from tensorboard.backend.event_processing import plugin_event_multiplexer
from tensorboard.plugins import base_plugin
from tensorboard.plugins.hparams import api_pb2, backend_context, get_experiment
from tensorboard.plugins.hparams import list_session_groups


def plain(value):
    kind = value.WhichOneof("kind")
    return getattr(value, kind) if kind else None


def main(folder):
    multiplexer = plugin_event_multiplexer.EventMultiplexer()
    multiplexer.AddRunsFromDirectory(folder)
    multiplexer.Reload()
    provider = data_provider.MultiplexerDataProvider(multiplexer, folder)
    plugin = backend_context.Context(base_plugin.TBContext(data_provider=provider, logdir=folder))
    of_request = context.RequestContext()

    request = api_pb2.GetExperimentRequest(include_metrics=True)
    experiment = get_experiment.Handler(of_request, plugin, "", request).run()
    metrics = {info.name.tag for info in experiment.metric_infos}
    assert "episode/reward" in metrics, metrics

    request = api_pb2.ListSessionGroupsRequest(
        start_index=0,
        slice_size=100,
        include_metrics=True,
        allowed_statuses=api_pb2.Status.values(),
    )
    found = {}
    for group in list_session_groups.Handler(of_request, plugin, "", request).run().session_groups:
        for session in group.sessions:
            found[session.name] = {
                "hparams": {name: plain(value) for name, value in group.hparams.items()},
                "status": api_pb2.Status.Name(session.status),
                "metrics": {m.name.tag: m.value for m in session.metric_values},
            }
    for run, path in multiplexer.RunPaths().items():
        reader = event_accumulator.EventAccumulator(path, {"scalars": 0})
        reader.Reload()
        for tag in reader.Tags()["scalars"]:
            steps = [event.step for event in reader.Scalars(tag)]
            assert steps == sorted(set(steps)), (run, tag)
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
