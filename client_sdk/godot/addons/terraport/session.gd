class_name TerraportSession
extends RefCounted
## State of a protocol 2 client over all its connections: no socket, no thread, no clock.
##
## The owner passes in commands and received messages, sends what [method messages_to_send]
## returns, and answers [signal payload_received] with [method accept] or [method reject]. Numbers
## in comments are sections of spec/protocol.md.

## The server said welcome.
signal opened(scene: Dictionary, limits: Dictionary)
signal planned(landing: int, plan: Dictionary)
## A segment is received and must be decoded.
signal payload_received(key: int, payload: PackedByteArray)
## The deadline has passed and the inner set is complete; the landing continues.
signal inner_completed(landing: int, keys: PackedInt64Array, hidden: PackedByteArray)
## A landing is complete: from now on these segments are shown and these base faces hidden.
signal completed(landing: int, keys: PackedInt64Array, hidden: PackedByteArray)
signal superseded(landing: int, by: int)
## The server refused a landing, or it was given up: its segments are damaged.
signal refused(landing: int, code: String, message: String)
## The server ends the connection.
signal failed(code: String, message: String)
signal picked(request: int, hit: Dictionary)
signal noticed(notice: Dictionary)
## A segment has left memory.
signal evicted(segment: TerraportSegment)

const _MAX_HAVE := 4096
const _MAX_WITHOUT := 64
## Deliveries of a damaged segment before its key is left out (4, rule 8).
const _MOST_FAILURES := 2


## One landing that the user asked for; it may be sent several times, as generations.
class Landing:
	var number := 0
	var position := PackedFloat64Array()
	var radius_m := 0.0
	## 0 for none; so is [member coarse_radius_m].
	var inner_radius_m := 0.0
	var coarse_radius_m := 0.0
	## The deadline has passed: the inner set is enough.
	var is_urgent := false
	## Generation of the message that was sent last; 0 while it waits to be sent.
	var generation := 0
	## Empty until it is received.
	var plan: Dictionary = {}
	## The server has sent everything.
	var is_ready := false
	var keys := PackedInt64Array()
	var hidden := PackedByteArray()
	## Keys of the plan that are neither in memory nor missing. Sets are dictionaries of true.
	var waiting: Dictionary[int, bool] = {}
	## Keys of the plan that cannot be delivered.
	var missing: Dictionary[int, bool] = {}
	## Until the plan is received: keys that [code]have[/code] listed, and those received since.
	var protected: Dictionary[int, bool] = {}
	var failures: Dictionary[int, int] = {}
	## Keys that failed too often.
	var without: Dictionary[int, bool] = {}


## Scene version of the newest connection; empty before the first.
var version := ""
## The server has said welcome on the present connection.
var is_open := false
## What the newest complete landing shows.
var shown_keys := PackedInt64Array()
var hidden := PackedByteArray()
## Keys that the owner draws; they stay in memory.
var drawn: Dictionary[int, bool] = {}
## Payload received although it was in memory; 0 with a correct server.
var repeated_bytes := 0
var received_bytes := 0

var _hello: Dictionary
var _credit_bytes: int
var _max_bytes: int
## Least recently used first.
var _held: Dictionary[int, TerraportSegment] = {}
var _held_bytes := 0
## Keys of payloads that the owner is decoding.
var _decoding: Dictionary[int, bool] = {}
var _outbox: Array[Dictionary] = []
## Landings that are neither shown nor ended, oldest first. Only the last may be shown; an older
## one continues if the server refuses the last.
var _open: Array[Landing] = []
var _picks: Dictionary[int, Dictionary] = {}
var _generation := 0
var _landings := 0
var _requests := 0
## The segment that is being received: key, total, data.
var _part: Dictionary = {}
var _taken_bytes := 0
var _granted_bytes := 0
var _acknowledged_bytes := 0
var _credit_step := 1
var _max_radius_m := INF
var _base_faces := 0


## [param credit_bytes] of payload may be on their way; [param max_bytes] of decoded segments stay
## in memory beside what is shown or waited for.
func _init(
		client: String, budgets: Dictionary, credit_bytes: int, max_bytes: int, token := ""
) -> void:
	_hello = {
		"type": "hello", "client": client, "budgets": budgets, "credit_bytes": credit_bytes,
	}
	if token != "":
		_hello["token"] = token
	_credit_bytes = credit_bytes
	_max_bytes = max_bytes


## Begin a connection.
func connection_opened() -> void:
	is_open = false
	_generation = 0
	_taken_bytes = 0
	_acknowledged_bytes = 0
	_granted_bytes = _credit_bytes
	_outbox = [_hello]


## End a connection. The newest landing and picks wait for the next one.
func connection_lost() -> void:
	is_open = false
	_outbox.clear()
	_part = {}
	if not _open.is_empty():
		var newest: Landing = _open.back()
		_end_landings_before(newest)
		_ask_again(newest)


## Request a landing, which replaces all that are not shown yet. Returns its number.
func land(
		position: PackedFloat64Array, radius_m: float, inner_radius_m := 0.0, coarse_radius_m := 0.0
) -> int:
	_landings += 1
	var landing := Landing.new()
	landing.number = _landings
	landing.position = position
	landing.radius_m = radius_m
	landing.inner_radius_m = inner_radius_m
	landing.coarse_radius_m = coarse_radius_m
	var replaced := 0
	if not _open.is_empty() and _open.back().generation == 0: # Not sent yet: it never is.
		replaced = _open.pop_back().number
	_open.append(landing)
	if replaced > 0:
		superseded.emit(replaced, landing.number)
	return landing.number


## Accept the inner set of a landing from now on.
func hurry(number: int) -> void:
	for landing: Landing in _open:
		if landing.number == number:
			landing.is_urgent = true
	_update()


## Prefetch what a landing there needs. Does nothing without a connection.
func prefetch(position: PackedFloat64Array, radius_m: float, coarse_radius_m := 0.0) -> void:
	if is_open:
		_outbox.append(_request("prefetch", position, radius_m, coarse_radius_m))


## Ask what full detail has along a ray, or on the vertical line. Returns the request's number.
func pick(origin: PackedFloat64Array, direction := PackedFloat64Array()) -> int:
	_requests += 1
	var message := {"type": "pick", "request": _requests, "origin": Array(origin)}
	if not direction.is_empty():
		message["direction"] = Array(direction)
	_picks[_requests] = message
	if is_open:
		_outbox.append(message)
	return _requests


## Return, once, the messages to send, in order. The landing's is built here, from what is in
## memory now: however often the user lands before that, one is sent.
func messages_to_send() -> Array[Dictionary]:
	var messages := _outbox
	_outbox = []
	if is_open and not _open.is_empty() and _open.back().generation == 0:
		messages.append(_land_message(_open.back()))
	return messages


## Return a segment in memory, or null.
func segment(key: int) -> TerraportSegment:
	return _held.get(key)


## Return whether all of these are in memory.
func has_all(keys: PackedInt64Array) -> bool:
	for key: int in keys:
		if key not in _held:
			return false
	return true


## Drop all segments from memory.
func forget() -> void:
	for decoded: TerraportSegment in _held.values():
		evicted.emit(decoded)
	_held.clear()
	_held_bytes = 0


## Take a segment that was decoded.
func accept(key: int, decoded: TerraportSegment) -> void:
	_decoding.erase(key)
	if key in _held: # Sent twice; the one that is held may be drawn.
		evicted.emit(decoded)
		return
	_held[key] = decoded
	_held_bytes += decoded.bytes
	for landing: Landing in _open:
		if landing.plan.is_empty():
			landing.protected[key] = true
		landing.waiting.erase(key)
	_trim()
	_update()


## Drop a damaged payload; a landing that needs it requests it again.
func reject(key: int) -> void:
	_decoding.erase(key)
	_update()


## Take one WebSocket message. Returns an error text for a violation of the protocol: the
## connection must then be closed with 4400.
func receive(data: PackedByteArray) -> String:
	var message := TerraportWire.decode(data)
	if message.is_empty():
		return ""
	match message.type:
		"malformed":
			return message.message
		"welcome":
			return _on_welcome(message)
		"error":
			_on_error(message)
		_ when not is_open:
			return "got %s first, expected welcome or error" % message.type
		"frame":
			return _on_frame(message)
		"plan":
			return _on_plan(message)
		"ready":
			return _on_ready(message)
		"picked":
			if _picks.erase(message.request):
				picked.emit(message.request, message.get("hit", {}))
		"notice":
			noticed.emit(message)
	return ""


func _on_welcome(welcome: Dictionary) -> String:
	if is_open:
		return "got a second welcome, expected one"
	is_open = true
	var scene: Dictionary = welcome.scene
	if version != scene.version: # Segments of the previous version are not part of this scene.
		version = scene.version
		shown_keys = PackedInt64Array()
		hidden = PackedByteArray()
	# Granted in halves: the server never runs dry while a grant is on its way (6).
	_credit_step = maxi(1, mini(_credit_bytes, welcome.limits.max_credit_bytes) / 2)
	_base_faces = scene.base_faces
	_max_radius_m = welcome.limits.max_radius_m
	_outbox.append_array(_picks.values())
	opened.emit(scene, welcome.limits)
	return ""


func _on_error(error: Dictionary) -> void:
	var text: String = error.get("message", "")
	if "request" in error and _picks.erase(error.request) and not error.fatal:
		refused.emit(0, error.code, text)
		return
	if error.fatal:
		failed.emit(error.code, text)
		return
	var number := 0
	for landing: Landing in _open:
		if landing.generation > 0 and landing.generation == error.get("generation"):
			number = landing.number
			_open.erase(landing)
			break
	refused.emit(number, error.code, text)
	_update() # An older landing continues (4, rule 7).


func _on_plan(plan: Dictionary) -> String:
	var landing := _landing_of(plan)
	if plan.generation > _generation:
		return "got a plan of generation %d, expected at most %d" % [plan.generation, _generation]
	if landing == null:
		return ""
	var bits := _inflated(plan.hidden)
	if bits.is_empty() and _base_faces > 0:
		return "got damaged hidden faces, expected %d" % _base_faces
	_end_landings_before(landing)
	landing.plan = plan
	landing.is_ready = false
	landing.hidden = bits
	landing.keys.clear()
	landing.waiting.clear()
	landing.missing.clear()
	for at: int in range(0, plan.show.size(), TerraportWire.ROW_BYTES):
		var key: int = plan.show.decode_s64(at)
		landing.keys.append(key)
		if key in _held:
			var touched := _held[key]
			_held.erase(key)
			_held[key] = touched
		else:
			landing.waiting[key] = true
	planned.emit(landing.number, plan)
	_trim()
	_update()
	return ""


func _on_ready(ready: Dictionary) -> String:
	if ready.generation > _generation:
		return "got ready of generation %d, expected at most %d" % [ready.generation, _generation]
	var landing := _landing_of(ready)
	if landing == null or landing.plan.is_empty():
		return ""
	landing.is_ready = true
	if "missing" in ready:
		for at: int in range(0, ready.missing.size(), TerraportWire.KEY_BYTES):
			landing.missing[ready.missing.decode_s64(at)] = true
			landing.waiting.erase(ready.missing.decode_s64(at))
		landing.hidden = _inflated(ready.get("hidden", PackedByteArray()))
		if landing.hidden.is_empty() and _base_faces > 0:
			return "got damaged hidden faces, expected %d" % _base_faces
	_update()
	return ""


func _on_frame(frame: Dictionary) -> String:
	var data: PackedByteArray = frame.data
	received_bytes += data.size()
	_taken_bytes += data.size()
	if _taken_bytes > _granted_bytes:
		return "got %d bytes of payload, expected at most %d" % [_taken_bytes, _granted_bytes]
	_grant_credit()
	if frame.offset == 0:
		_part = {"key": frame.key, "total": frame.total, "data": PackedByteArray()}
	if _part.is_empty() or _part.key != frame.key or _part.total != frame.total \
			or _part.data.size() != frame.offset:
		return "got byte %d of a segment, expected the one behind the frame before" % frame.offset
	_part.data.append_array(data)
	if _part.data.size() < frame.total:
		return ""
	var payload: PackedByteArray = _part.data
	_part = {}
	if frame.key in _held or frame.key in _decoding:
		repeated_bytes += frame.total
	_decoding[frame.key] = true
	payload_received.emit(frame.key, payload)
	return ""


func _grant_credit() -> void:
	var granted := _taken_bytes - _acknowledged_bytes
	if granted < _credit_step:
		return
	_acknowledged_bytes = _taken_bytes
	_granted_bytes += granted
	for message: Dictionary in _outbox: # One grant at a time: the outbox stays short.
		if message.type == "credit":
			message.bytes += granted
			return
	_outbox.append({"type": "credit", "bytes": granted})


func _landing_of(message: Dictionary) -> Landing:
	for landing: Landing in _open:
		if landing.generation > 0 and landing.generation == message.generation:
			return landing
	return null


# Show the newest landing if it is complete; request again what was not received.
func _update() -> void:
	if _open.is_empty() or _open.back().plan.is_empty():
		return
	var landing: Landing = _open.back()
	if landing.waiting.is_empty():
		_open.clear()
		shown_keys = _present(landing, landing.keys)
		hidden = landing.hidden
		completed.emit(landing.number, shown_keys, hidden)
		_trim()
		return
	var is_decoding := landing.waiting.keys().any(func(key: int) -> bool: return key in _decoding)
	if landing.is_ready and not is_decoding:
		_retry(landing)
	elif landing.is_urgent and "inner_count" in landing.plan:
		var inner := landing.keys.slice(0, landing.plan.inner_count)
		if not Array(inner).any(func(key: int) -> bool: return key in landing.waiting):
			landing.is_urgent = false
			var packed: PackedByteArray = landing.plan.get("inner_hidden", PackedByteArray())
			inner_completed.emit(landing.number, _present(landing, inner), _inflated(packed))


# Request a landing again after failed deliveries; give it up where more keys failed than may be
# left out.
func _retry(landing: Landing) -> void:
	for key: int in landing.waiting:
		landing.failures[key] = landing.failures.get(key, 0) + 1
		if landing.failures[key] >= _MOST_FAILURES:
			landing.without[key] = true
	if landing.without.size() <= _MAX_WITHOUT:
		_ask_again(landing)
		return
	_open.erase(landing)
	refused.emit(landing.number, "damaged",
			("got %d damaged segments, expected at most %d; "
			+ "is something between here and the service changing payload?")
			% [landing.without.size(), _MAX_WITHOUT])


func _present(landing: Landing, keys: PackedInt64Array) -> PackedInt64Array:
	var present := Array(keys).filter(func(key: int) -> bool: return key not in landing.missing)
	return PackedInt64Array(present)


func _ask_again(landing: Landing) -> void:
	landing.protected = _needs(landing).duplicate()
	landing.generation = 0
	landing.plan = {}
	landing.is_ready = false
	landing.waiting.clear()


# Keys that must not leave memory before a landing is shown (4, rule 4).
func _needs(landing: Landing) -> Dictionary[int, bool]:
	if landing.plan.is_empty():
		return landing.protected
	var needed: Dictionary[int, bool] = {}
	for key: int in landing.keys:
		needed[key] = true
	return needed


func _land_message(landing: Landing) -> Dictionary:
	var message := _request(
			"land", landing.position, landing.radius_m, landing.coarse_radius_m)
	landing.generation = _generation
	landing.protected.clear()
	for at: int in range(0, message.have.size(), TerraportWire.KEY_BYTES):
		landing.protected[message.have.decode_s64(at)] = true
	if landing.inner_radius_m > 0.0:
		message["inner_radius_m"] = landing.inner_radius_m
	if not landing.without.is_empty():
		message["without"] = PackedInt64Array(landing.without.keys()).to_byte_array()
	return message


func _request(
		type: String, position: PackedFloat64Array, radius_m: float, coarse_radius_m: float
) -> Dictionary:
	_generation += 1
	var message := {
		"type": type, "generation": _generation, "position": Array(position),
		"radius_m": radius_m, "taken_bytes": _taken_bytes,
	}
	var reach_m := radius_m
	if coarse_radius_m > 0.0: # Less coarse ground is better than no landing.
		reach_m = maxf(radius_m, minf(coarse_radius_m, _max_radius_m))
		message["coarse_radius_m"] = reach_m
	message["have"] = _held_near(position, reach_m).to_byte_array()
	return message


# Keys near a place that are in memory or being decoded, the nearest first.
func _held_near(position: PackedFloat64Array, reach_m: float) -> PackedInt64Array:
	var near: Array = []
	for key: int in _held:
		var bounds := _held[key].bounds
		var distance := 0.0
		var diagonal := 0.0
		for axis: int in 3:
			var away := maxf(maxf(
					bounds[axis] - position[axis], position[axis] - bounds[axis + 3]), 0.0)
			distance += away * away
			diagonal += (bounds[axis + 3] - bounds[axis]) ** 2
		# The server goes by the box of the finer level: a coarser one differs by a little.
		if sqrt(distance) <= reach_m + sqrt(diagonal):
			near.append([distance, key])
	near.sort()
	var keys := PackedInt64Array(_decoding.keys().slice(0, _MAX_HAVE))
	for one: Array in near.slice(0, _MAX_HAVE - keys.size()):
		if one[1] not in _decoding:
			keys.append(one[1])
	return keys


func _end_landings_before(landing: Landing) -> void:
	while _open[0] != landing:
		superseded.emit(_open.pop_front().number, landing.number)


func _trim() -> void:
	if _held_bytes <= _max_bytes:
		return
	var needed := drawn.duplicate()
	for key: int in shown_keys:
		needed[key] = true
	for landing: Landing in _open:
		needed.merge(_needs(landing))
	for key: int in _held.keys():
		if _held_bytes <= _max_bytes:
			return
		if key not in needed:
			var gone := _held[key]
			_held_bytes -= gone.bytes
			_held.erase(key)
			evicted.emit(gone)


# Inflate the bits of hidden base faces; empty if they are damaged.
func _inflated(packed: PackedByteArray) -> PackedByteArray:
	var size := (_base_faces + 7) / 8
	if packed.size() < 18 or packed.decode_u32(packed.size() - 4) != size or size == 0:
		return PackedByteArray()
	var bits := packed.decompress(size, FileAccess.COMPRESSION_GZIP)
	return bits if bits.size() == size else PackedByteArray()
