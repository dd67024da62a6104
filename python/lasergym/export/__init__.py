"""Trained policies as files for the runner, which needs neither Python nor torch.

Needs the extra ``lasergym[train]``.
"""

from lasergym.errors import MissingExtraError

try:
    import safetensors as _safetensors
    import torch as _torch
except ImportError as _error:
    raise MissingExtraError(
        'lasergym.export needs torch and safetensors: pip install "lasergym[train]"'
    ) from _error

from lasergym.export.errors import ExportError, ParityError, UnsupportedLayerError
from lasergym.export.file import ExportResult, export_module, network_bytes, write_network
from lasergym.export.network import (
    ActionMapping,
    ExportablePolicy,
    ExportedLayer,
    ExportedNetwork,
    ObservationScaling,
    RunningNormalisation,
)
from lasergym.export.parity import ParityReport, parity_report
from lasergym.export.policy import export_policy
from lasergym.export.storage import StorageName
from lasergym.export.tracing import trace_module

__all__ = [
    "ActionMapping",
    "ExportError",
    "ExportResult",
    "ExportablePolicy",
    "ExportedLayer",
    "ExportedNetwork",
    "ObservationScaling",
    "ParityError",
    "ParityReport",
    "RunningNormalisation",
    "StorageName",
    "UnsupportedLayerError",
    "export_module",
    "export_policy",
    "network_bytes",
    "parity_report",
    "trace_module",
    "write_network",
]

del _safetensors, _torch
