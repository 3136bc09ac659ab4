extends RefCounted
## Plays what the corpora of tests/conformance hold; the tests compare what comes of it.

var _session: TerraportSession
var _inner: Array = []
var _refused: Array = []


## What must come of each step of a history, as tests/conformance/landings has it.
func play(options: Dictionary, steps: Array) -> Array:
	var budgets := {}
	if options.max_segments != null:
		budgets["max_segments"] = int(options.max_segments)
	_session = TerraportSession.new("corpus", budgets, int(options.credit_bytes), 1 << 30)
	_session.payload_received.connect(_on_payload)
	_session.inner_completed.connect(
			func(_landing: int, keys: PackedInt64Array, bits: PackedByteArray) -> void:
				_inner = [keys.size(), bits.hex_encode()])
	_session.refused.connect(
			func(landing: int, code: String, _text: String) -> void: _refused = [landing, code])
	return steps.map(func(step: Array) -> Dictionary:
		_inner = []
		_refused = []
		var told := _play(step)
		told["shown"] = _hex_keys(_session.shown_keys)
		told["hidden"] = _session.hidden.hex_encode()
		told["inner"] = _inner
		told["refused"] = _refused
		return told)


## Messages in base64 as a client reads them.
func read(messages: Array) -> Array:
	return messages.map(func(text: String) -> Dictionary:
		return _plain(TerraportWire.decode(Marshalls.base64_to_raw(text))))


## Messages as a client writes them, in hexadecimal digits.
func write(messages: Array) -> Array:
	return messages.map(func(message: Dictionary) -> String:
		return TerraportWire.encode(message).hex_encode())


## A payload in base64, decoded.
func decode(payload: String, attributes: Array, wanted: String) -> Dictionary:
	var got := TerraportSegment.decode(Marshalls.base64_to_raw(payload), attributes, wanted)
	return {
		"error": got.error, "faces": got.faces, "region": got.region,
		"positions": got.positions.to_byte_array().hex_encode(),
		"normals": got.normals.to_byte_array().hex_encode(),
		"uvs": got.uvs.to_byte_array().hex_encode(),
		"colours": Array(got.colours).map(func(one: Color) -> Array: return [one.r8, one.g8, one.b8]),
		"facts": got.facts.to_byte_array().hex_encode(),
		"image": [] if got.image == null else [got.image.get_width(), got.image.get_height()],
	}


func _play(step: Array) -> Dictionary:
	match step[0]:
		"connected":
			_session.connection_opened()
		"lost":
			_session.connection_lost()
		"receive":
			return {"error": _session.receive(Marshalls.base64_to_raw(step[1]))}
		"land":
			_session.land(PackedFloat64Array(step[1]), step[2], _or_zero(step[3]), _or_zero(step[4]))
		"hurry":
			_session.hurry(int(step[1]))
		"aim":
			_session.prefetch(PackedFloat64Array(step[1]), step[2])
		"pick":
			_session.pick(PackedFloat64Array(step[1]))
		"send":
			return {"sent": _session.messages_to_send().map(func(message: Dictionary) -> Dictionary:
				return _plain(TerraportWire.new().read(TerraportWire.encode(message))))}
	return {}


func _or_zero(value: Variant) -> float:
	return 0.0 if value == null else value


func _on_payload(key: int, payload: PackedByteArray) -> void:
	var segment := TerraportSegment.decode(payload)
	if segment.error == "":
		_session.accept(key, segment)
	else:
		_session.reject(key)


func _hex_keys(keys: PackedInt64Array) -> Array:
	return Array(keys).map(func(key: int) -> String:
		var bytes := PackedInt64Array([key]).to_byte_array()
		bytes.reverse()
		return bytes.hex_encode())


# JSON has no bytes: tables of keys become lists, all else hexadecimal digits.
func _plain(message: Dictionary) -> Dictionary:
	for name: Variant in message:
		if name in ["have", "without"]:
			message[name] = _hex_keys(message[name].to_int64_array())
		elif message[name] is PackedByteArray:
			message[name] = message[name].hex_encode()
		elif message.get("type") == "frame" and name == "key":
			message[name] = _hex_keys([message[name]])[0]
	return message
