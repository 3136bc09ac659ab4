class_name TerraportWire
extends RefCounted
## Messages and payload frames of protocol 2 (spec/protocol.md), in msgpack.
##
## Maps have text keys, integers and floats stay apart, binary is a [PackedByteArray].

const SUBPROTOCOL := "terraport.v2.msgpack"
## Bytes of one row of a plan's table [code]show[/code].
const ROW_BYTES := 28
## In a row's flags: it is of the coarser level.
const ROW_IS_COARSE := 2
const KEY_BYTES := 8
const MAX_FRAME_BYTES := 128 * 1024
const MAX_SEGMENT_BYTES := 64 << 20

const _FRAME_HEADER_BYTES := 24
const _MAX_FRAME_HEADER_BYTES := 1024
const _MAX_DEPTH := 32
## Most items of one array or map.
const _MAX_ITEMS := 16_384
const _NUMBER := TYPE_FLOAT
const _POINT := TYPE_VECTOR3
const _BYTES := TYPE_PACKED_BYTE_ARRAY
## Types of the fields that a client reads; a name that ends with "?" is optional.
const _FIELDS := {
	"welcome": {"scene": TYPE_DICTIONARY, "limits": TYPE_DICTIONARY},
	"welcome.scene": {
		"version": TYPE_STRING, "segment_count": TYPE_INT, "base_faces": TYPE_INT,
		"levels": TYPE_INT,
	},
	"welcome.limits": {
		"max_radius_m": _NUMBER, "max_messages_per_s": _NUMBER, "max_credit_bytes": TYPE_INT,
	},
	"plan": {
		"generation": TYPE_INT, "show": _BYTES, "hidden": _BYTES, "inner_count?": TYPE_INT,
		"inner_hidden?": _BYTES, "effective_radius_m": _NUMBER, "omitted": TYPE_INT,
		"omitted_by?": TYPE_STRING,
	},
	"ready": {"generation": TYPE_INT, "missing?": _BYTES, "hidden?": _BYTES},
	"picked": {"request": TYPE_INT, "hit?": TYPE_DICTIONARY},
	"picked.hit": {"position": _POINT, "normal": _POINT, "height_m": _NUMBER},
	"notice": {"kind": TYPE_STRING, "reconnect_after_ms?": TYPE_INT},
	"error": {
		"code": TYPE_STRING, "message?": TYPE_STRING, "fatal": TYPE_BOOL, "generation?": TYPE_INT,
		"request?": TYPE_INT,
	},
}
## Bytes of an element of a binary table.
const _ELEMENT_BYTES := {"show": ROW_BYTES, "missing": KEY_BYTES}

var _input := StreamPeerBuffer.new()
var _error := ""


## Encode an int, float, String, PackedByteArray, Array or Dictionary.
static func encode(value: Variant) -> PackedByteArray:
	var output := StreamPeerBuffer.new()
	output.big_endian = true
	_write(output, value)
	return output.data_array


## Decode one WebSocket message.
##
## Returns its fields, among them [code]type[/code]. A payload frame has the type [code]frame[/code]
## and generation, key, offset, total, data. Returns an empty dictionary for a message to skip, and
## one of type [code]malformed[/code] with a [code]message[/code] for a violation of the protocol.
static func decode(data: PackedByteArray) -> Dictionary:
	if data.is_empty() or data[0] == 0:
		return _malformed("an empty message", "a frame or a map")
	if data[0] < 0x80:
		return _decode_frame(data) if data[0] == 1 else {}
	var reader := TerraportWire.new()
	var value: Variant = reader.read(data)
	if reader._error != "":
		return _malformed(reader._error, "one msgpack value")
	if value is not Dictionary or value.get("type") is not String:
		return _malformed("no map with a type", "a message")
	return _checked(value.type, value) if value.type in _FIELDS else {}


## Decode one msgpack value; null if the bytes are not exactly one.
func read(data: PackedByteArray) -> Variant:
	_input.big_endian = true
	_input.data_array = data
	var value: Variant = _read(0)
	if _available() > 0 and _error == "":
		_error = "%d bytes behind a value" % _available()
	return value if _error == "" else null


static func _malformed(got: String, expected: String) -> Dictionary:
	return {"type": "malformed", "message": "got %s, expected %s" % [got, expected]}


static func _checked(kind: String, message: Dictionary) -> Dictionary:
	var fields: Dictionary = _FIELDS[kind]
	for spelled: String in fields:
		var name := spelled.trim_suffix("?")
		var value: Variant = message.get(name)
		if value == null:
			message.erase(name)
			if name == spelled:
				return _malformed("%s without %s" % [kind, name], "it")
			continue
		if not _has_type(value, fields[spelled]) \
				or (name in _ELEMENT_BYTES and value.size() % _ELEMENT_BYTES[name] != 0):
			return _malformed("another type of %s.%s" % [kind, name], type_string(fields[spelled]))
		var inner := "%s.%s" % [kind, name]
		if inner in _FIELDS and _checked(inner, value).get("type") == "malformed":
			return _malformed("a damaged %s" % inner, "its fields")
	return message


static func _has_type(value: Variant, type: int) -> bool:
	if type == _POINT:
		return value is Array and value.size() == 3 \
				and value.all(func(one: Variant) -> bool: return _has_type(one, _NUMBER))
	if type == _NUMBER:
		return value is int or (value is float and is_finite(value))
	return typeof(value) == type


static func _decode_frame(data: PackedByteArray) -> Dictionary:
	var size := data.size()
	if size <= _FRAME_HEADER_BYTES or size > MAX_FRAME_BYTES:
		return _malformed("a frame of %d bytes" % size, "25 to %d" % MAX_FRAME_BYTES)
	var header := data.decode_u16(2)
	var offset := data.decode_u32(16)
	var total := data.decode_u32(20)
	if header < _FRAME_HEADER_BYTES or header > _MAX_FRAME_HEADER_BYTES or header >= size \
			or total > MAX_SEGMENT_BYTES or offset + size - header > total:
		return _malformed("byte %d of %d behind a header of %d" % [offset, total, header], "less")
	return {
		"type": "frame", "generation": data.decode_u32(4), "key": data.decode_s64(8),
		"offset": offset, "total": total, "data": data.slice(header),
	}


static func _write(output: StreamPeerBuffer, value: Variant) -> void:
	match typeof(value):
		TYPE_INT:
			output.put_u8(0xD3)
			output.put_64(value)
		TYPE_FLOAT:
			output.put_u8(0xCB)
			output.put_double(value)
		TYPE_STRING:
			var text: PackedByteArray = value.to_utf8_buffer()
			output.put_u8(0xDB)
			output.put_u32(text.size())
			output.put_data(text)
		TYPE_PACKED_BYTE_ARRAY:
			output.put_u8(0xC6)
			output.put_u32(value.size())
			output.put_data(value)
		TYPE_DICTIONARY:
			output.put_u8(0xDF)
			output.put_u32(value.size())
			for key: String in value:
				_write(output, key)
				_write(output, value[key])
		_:
			output.put_u8(0xDD)
			output.put_u32(value.size())
			for one: Variant in value:
				_write(output, one)


func _available() -> int:
	return _input.get_size() - _input.get_position()


# Return whether so many bytes are left; if not, the message is malformed.
func _has(count: int) -> bool:
	if _error == "" and count > _available():
		_error = "%d bytes" % _available()
	return _error == ""


func _read(depth: int) -> Variant:
	if not _has(1) or depth > _MAX_DEPTH:
		_error = "a value that is cut off or nested too deep"
		return null
	var tag := _input.get_u8()
	if tag < 0x80:
		return tag
	if tag < 0x90:
		return _read_map(tag & 15, depth)
	if tag < 0xA0:
		return _read_array(tag & 15, depth)
	if tag < 0xC0:
		return _read_text(tag & 31)
	if tag >= 0xE0:
		return tag - 256
	match tag:
		0xC0:
			return null
		0xC2, 0xC3:
			return tag == 0xC3
		0xC4, 0xC5, 0xC6:
			var count := _read_unsigned(1 << (tag - 0xC4))
			return _input.get_data(count)[1] if _has(count) else null
		0xCA:
			return _input.get_float() if _has(4) else 0.0
		0xCB:
			return _input.get_double() if _has(8) else 0.0
		0xCC, 0xCD, 0xCE, 0xCF:
			return _read_unsigned(1 << (tag - 0xCC))
		0xD0, 0xD1, 0xD2, 0xD3:
			var bits := 8 << (tag - 0xD0)
			var value := _read_unsigned(bits >> 3)
			return value if bits == 64 or value < 1 << (bits - 1) else value - (1 << bits)
		0xD9, 0xDA, 0xDB:
			return _read_text(_read_unsigned(1 << (tag - 0xD9)))
		0xDC, 0xDD:
			return _read_array(_read_unsigned(2 << (tag - 0xDC)), depth)
		0xDE, 0xDF:
			return _read_map(_read_unsigned(2 << (tag - 0xDE)), depth)
	_error = "the tag 0x%x" % tag
	return null


func _read_unsigned(count: int) -> int:
	if not _has(count):
		return 0
	match count:
		1:
			return _input.get_u8()
		2:
			return _input.get_u16()
		4:
			return _input.get_u32()
	return _input.get_64()


func _read_text(count: int) -> String:
	return _input.get_utf8_string(count) if _has(count) else ""


# Refuse a container that no message needs before memory is taken for it.
func _check_items(count: int) -> void:
	if _error == "" and count > _MAX_ITEMS:
		_error = "%d items, more than %d" % [count, _MAX_ITEMS]


func _read_array(count: int, depth: int) -> Array:
	var values: Array = []
	_check_items(count)
	while _has(count - values.size()) and values.size() < count:
		values.append(_read(depth + 1))
	return values


func _read_map(count: int, depth: int) -> Dictionary:
	var values: Dictionary = {}
	_check_items(count)
	for left: int in range(count, 0, -1):
		if not _has(2 * left):
			break
		var key: Variant = _read(depth + 1)
		values[key] = _read(depth + 1)
	return values
