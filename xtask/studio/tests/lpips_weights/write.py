"""Writes alexnet.pth and alex.pth: files as PyTorch writes them, by Python's own pickle and zipfile.

The trained weights may not be distributed; these have the shapes and names of torchvision's AlexNet and of the heads of
the lpips package, and weights from the formula of codec/refine/src/fit/fixtures.rs, which a zip archive makes small.
torch.save writes the same pickles: a tensor is a call of torch._utils._rebuild_tensor_v2 with a persistent id for its
storage. alexnet.pth has the archive of PyTorch 1.6 and later, alex.pth the stream of pickles before it.
"""

import collections
import io
import pickle
import struct
import sys
import types
import zipfile


class FloatStorage:
    """Stands for the class of this name in torch."""


def _rebuild_tensor_v2(*_):
    """Stands for the function of this name in torch._utils."""


for name, item in (("torch", FloatStorage), ("torch._utils", _rebuild_tensor_v2)):
    sys.modules[name] = types.ModuleType(name)
    setattr(sys.modules[name], item.__name__, item)
    item.__module__ = name


class Storage:
    def __init__(self, key, values):
        self.key, self.count = str(key), len(values)
        self.data = struct.pack(f"<{len(values)}f", *values)


class Tensor:
    def __init__(self, storage, shape):
        self.storage, self.shape = storage, shape

    def __reduce__(self):
        stride = [1]
        for length in self.shape[:0:-1]:
            stride.insert(0, stride[0] * length)
        no_hooks = collections.OrderedDict()
        return _rebuild_tensor_v2, (self.storage, 0, self.shape, tuple(stride), False, no_hooks)


class Pickler(pickle.Pickler):
    def persistent_id(self, obj):
        if isinstance(obj, Storage):
            return "storage", FloatStorage, obj.key, "cpu", obj.count
        return None


def pickled(obj):
    file = io.BytesIO()
    Pickler(file, protocol=2).dump(obj)
    return file.getvalue()


def state_dict(tensors):
    storages = [Storage(key, values) for key, (_, _, values) in enumerate(tensors)]
    named = ((name, Tensor(storage, shape)) for storage, (name, shape, _) in zip(storages, tensors))
    return storages, collections.OrderedDict(named)


def save_archive(path, tensors):
    storages, state = state_dict(tensors)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        entries = [("data.pkl", pickled(state)), ("byteorder", b"little"), ("version", b"3\n")]
        for name, data in entries + [(f"data/{storage.key}", storage.data) for storage in storages]:
            info = zipfile.ZipInfo(f"archive/{name}")
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, data)


def save_stream(path, tensors):
    storages, state = state_dict(tensors)
    sizes = {"short": 2, "int": 4, "long": 4}
    system = {"protocol_version": 1001, "little_endian": True, "type_sizes": sizes}
    with open(path, "wb") as file:
        for obj in (0x1950A86A20F9469CFC6C, 1001, system, state, [storage.key for storage in storages]):
            file.write(pickled(obj))
        for storage in storages:
            file.write(struct.pack("<q", storage.count) + storage.data)


def layer_weights(count, layer, scale):
    return [(((i * 7919 + layer * 104729) % 1009) / 1009.0 - 0.5) * scale for i in range(count)]


LAYERS = [(0, 3, 64, 11), (3, 64, 192, 5), (6, 192, 384, 3), (8, 384, 256, 3), (10, 256, 256, 3)]

trunk, heads = [], []
for i, (number, inputs, outputs, side) in enumerate(LAYERS):
    fan_in = inputs * side * side
    kernel = layer_weights(outputs * fan_in, number, (24.0 / fan_in) ** 0.5)
    trunk.append((f"features.{number}.weight", (outputs, inputs, side, side), kernel))
    trunk.append((f"features.{number}.bias", (outputs,), layer_weights(outputs, number + 100, 0.2)))
    head = [((channel * 31 + i) % 97) / 97.0 for channel in range(outputs)]
    heads.append((f"lin{i}.model.1.weight", (1, outputs, 1, 1), head))
# LPIPS does not use the classifier.
trunk.append(("classifier.6.bias", (1000,), [0.0] * 1000))
save_archive("alexnet.pth", trunk)
save_stream("alex.pth", heads)
