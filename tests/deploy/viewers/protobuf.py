"""Decoder of protobuf by the schema in a file, without people4d's own message types."""

from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass


def decode(schema_name: str, schema: bytes, data: bytes) -> Any:
    """Decode a message by its schema."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.AddSerializedFile(file.SerializeToString())
    return GetMessageClass(pool.FindMessageTypeByName(schema_name)).FromString(data)
