meta:
  id: tsuya
  title: tsuya, objects captured with their measured appearance
  file-extension: tsuya
  license: MIT OR Apache-2.0
  endian: le
  ks-version: "0.10"
doc: |
  The container of spec/container.md, version 0.1: signature, version, sections one directly after the other, a directory of their headers,
  its length, and an end signature. What a section holds is described by the other documents of spec/. Checksums are not verified here.
doc-ref: container.md
seq:
  - id: signature
    contents: [0xe8, 0x54, 0x53, 0x59, 0x0d, 0x0a, 0x1a, 0x0a]
  - id: version_major
    type: u2
  - id: version_minor
    type: u2
  - id: sections
    type: section
    repeat: expr
    repeat-expr: directory.count.value
instances:
  directory_length:
    pos: _io.size - 8
    type: u4
  end_signature:
    pos: _io.size - 4
    contents: [0x59, 0x53, 0x54, 0xe8]
  directory:
    pos: _io.size - 8 - directory_length
    size: directory_length
    type: directory
types:
  varint:
    doc: Seven bits a byte, the lowest first; the high bit says that more follow.
    seq:
      - id: bytes
        type: u1
        repeat: until
        repeat-until: _ < 128
    instances:
      value:
        value: >-
          (bytes[0] & 127)
          + (bytes.size > 1 ? (bytes[1] & 127) * 128 : 0)
          + (bytes.size > 2 ? (bytes[2] & 127) * 16384 : 0)
          + (bytes.size > 3 ? (bytes[3] & 127) * 2097152 : 0)
          + (bytes.size > 4 ? (bytes[4] & 127) * 268435456 : 0)
          + (bytes.size > 5 ? (bytes[5] & 127) * 34359738368 : 0)
  section_header:
    seq:
      - id: tag
        type: str
        size: 4
        encoding: ASCII
      - id: codec
        type: u1
        enum: codec
      - id: stored_length
        type: varint
      - id: decoded_length
        type: varint
        if: codec == codec::zstd
      - id: crc32
        type: u4
        doc: Of the header's bytes before it and of the stored bytes.
  section:
    seq:
      - id: header
        type: section_header
      - id: stored
        size: header.stored_length.value
  directory:
    seq:
      - id: tag
        contents: DRCT
      - id: count
        type: varint
      - id: headers
        type: section_header
        repeat: expr
        repeat-expr: count.value
      - id: crc32
        type: u4
        doc: Of the file's first 12 bytes and of the directory up to here.
enums:
  codec:
    0: none
    1: zstd
    2: own
