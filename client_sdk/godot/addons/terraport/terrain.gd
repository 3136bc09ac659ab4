class_name TerraportTerrain
extends Node3D
## A scene that a terraport service streams: its base, and full detail around one place at a time.
##
## Set [member url] and call [method land]. The node is the scene's origin: x is east, y up, -z
## north, in metres. Positions are in the world; the node may be moved and turned, but not scaled.

## The base is shown, landings are possible.
signal opened
## What a landing will show: [code]segments[/code], [code]effective_radius_m[/code],
## [code]omitted[/code], and [code]omitted_by[/code], the budget that left segments out.
signal planned(landing: int, facts: Dictionary)
## With [member auto_show] off: [method show_landing] would show it now.
signal presentable(landing: int)
## In the frame in which what is drawn changes.
signal shown(landing: int)
## A newer landing took the place of one that was not shown yet.
signal superseded(landing: int, by: int)
## The service refused a landing, or a pick (landing 0), or more segments of a landing are damaged
## than can be left out; what is shown stays.
signal refused(landing: int, code: String, message: String)
## Answer to [method pick]; empty where nothing was hit.
signal picked(request: int, hit: Dictionary)
signal link_changed(state: Link)
## The connection is closed for good. [param code] is one of the protocol's.
signal failed(code: String, message: String)

enum Link { CLOSED, CONNECTING, OPEN, WAITING }
enum Device { DESKTOP, HEADSET, CUSTOM }
enum Look { COLOUR, REGIONS, SEGMENTS, ATTRIBUTE, SLOPE }

const CLIENT := "terraport-godot/0.1.0"
## Most triangles, segments and MiB of payload of a landing, and MiB of meshes kept in memory beside
## what is shown.
const BUDGETS := {
	Device.DESKTOP: [3_000_000, 2048, 128, 512],
	Device.HEADSET: [900_000, 512, 32, 256],
}

## Payload that may be under way: about a second of a fast connection.
const _CREDIT_BYTES := 4 << 20
## Room for that and for the largest message.
const _INBOUND_BYTES := 16 << 20
const _OUTBOUND_BYTES := 1 << 20
const _PING_PERIOD_S := 15.0
const _CONNECT_S := 10.0
const _FIRST_WAIT_S := 0.5
const _MAX_WAIT_S := 30.0
## A connection that lived so long was a good one: after it the first wait is short again.
const _STABLE_S := 10.0
const _PREFETCH_PERIOD_S := 0.1
const _MAX_TASKS := 4
## Places that can be returned to in one frame.
const _MAX_VISITS := 32
const _COARSE_RADII := 3.0
const _MASK_WIDTH := 256
const _MAX_BASE_IMAGE := 4096
## Close codes after which another connection would end the same way.
const _FINAL_CLOSE_CODES: Array[int] = [1000, 4400, 4401, 4403, 4404, 4409, 4413]
const _FINAL_STATUSES := {
	400: "malformed", 401: "unauthorised", 403: "forbidden", 404: "unknown_scene",
}
const _SHADER := preload("ground.gdshader")

## Address of the scene: [code]https://HOST/scenes/ID[/code].
@export var url := ""
## Access token. It would be saved in the clear: set it at run time.
@export var token := ""
## Default radius of a landing, metres.
@export_range(1.0, 500.0) var radius_m := 60.0
@export var open_on_ready := true
## Land at [member landing_at_start] (scene frame) as soon as the scene is open.
@export var land_on_open := true
@export var landing_at_start := Vector3.ZERO
## Show a landing as soon as it is complete; if off, call [method show_landing], behind a fade.
@export var auto_show := true
## Show a ring of the coarser level, to three times the radius, in scenes that have one.
@export var shows_coarse := true
@export var look := Look.COLOUR:
	set(value):
		look = value
		_set_parameter("look", look)
## Attribute of the survey for [constant Look.ATTRIBUTE]; from the next [method open] on.
@export var attribute := ""
## Use the engine's lights instead of shading as on a map; from the next [method open] on.
@export var lit := false
## Physics layers of the full detail as a static body; from the next [method open] on.
@export_flags_3d_physics var collision_layer := 0
## Time that one frame gives to decoding and uploads, milliseconds.
@export_range(0.2, 20.0) var frame_budget_ms := 4.0
## Chooses [constant BUDGETS], or [member custom_budgets]; from the next [method open] on.
@export var device := Device.DESKTOP
@export var custom_budgets: Array[int] = [3_000_000, 2048, 128, 512]

## The scene's manifest (spec/scene-format.md, section 4); empty before it is known.
var manifest: Dictionary = {}
var link := Link.CLOSED
## Base faces that are hidden: one bit a face, the lowest bit first. Empty for none.
var hidden_faces := PackedByteArray()
## Numbers of the segments that are shown, ascending.
var visible_segments: PackedInt32Array:
	get:
		var numbers := PackedInt32Array()
		for key: int in _drawn:
			numbers.append(_numbers[key])
		numbers.sort()
		return numbers

var _session: TerraportSession
var _socket: WebSocketPeer
var _max_messages_per_s := 1.0
## Code and message of the service's fatal error, or empty.
var _refusal: Array[String] = []
var _attempt := 0
## When the service said welcome; INF before.
var _welcomed_at_s := INF
var _first_wait_s := -1.0
var _retry_at_s := INF
var _connect_by_s := INF
var _next_send_s := 0.0
var _next_prefetch_s := 0.0
## Place and radius to prefetch, or empty.
var _prefetch: Array = []
var _waiting: Array[Job] = []
var _running: Array[Job] = []
var _shader: Shader
var _base: TerraportSegment
var _base_version := ""
var _opened_version := ""
## Keys of the segments that are drawn.
var _drawn: Dictionary[int, bool] = {}
## Segment numbers by key.
var _numbers: Dictionary[int, int] = {}
## Keys and hidden faces of completed landings, by place and radius.
var _visits: Dictionary[Array, Array] = {}
## Place and radii of each landing that is not complete.
var _places: Dictionary[int, Array] = {}
## Place and radii of the newest landing that is complete, or empty.
var _standing: Array = []
## Time from which the inner set of a landing is enough.
var _deadlines: Dictionary[int, float] = {}
## Landing, keys and hidden faces that are shown once the base of their version is there and
## [method show_landing] is called, or empty.
var _offer: Array = []


## A payload that is decoded on a thread.
class Job:
	var key := 0
	var payload: PackedByteArray
	var attributes: Array
	var attribute: String
	var max_side := 2048
	## The attributes are those of a version that is gone: the payload is to be decoded again.
	var is_stale := false
	var task := 0
	var result: TerraportSegment

	func start() -> void:
		task = WorkerThreadPool.add_task(func() -> void:
			result = TerraportSegment.decode(payload, attributes, attribute, max_side))

	func is_done() -> bool:
		if not WorkerThreadPool.is_task_completed(task):
			return false
		WorkerThreadPool.wait_for_task_completion(task)
		return true


func _ready() -> void:
	if open_on_ready and url != "":
		open()


func _exit_tree() -> void:
	close()


func _process(_delta: float) -> void:
	# Code that a signal calls may close the scene: this reference keeps the session for the frame.
	var session := _session
	if session == null:
		return
	if _now_s() >= _retry_at_s:
		_connect_to_service()
	if _socket != null:
		_receive()
	_decode_and_upload()
	for landing: int in _deadlines.keys():
		if _now_s() >= _deadlines.get(landing, INF):
			_deadlines.erase(landing)
			session.hurry(landing)
	if _socket != null and _socket.get_ready_state() == WebSocketPeer.STATE_OPEN:
		_send()


## Open [member url]; what was open is closed.
func open() -> void:
	close()
	var budgets: Array = BUDGETS.get(device, custom_budgets)
	var wanted := {
		"max_triangles": budgets[0], "max_segments": budgets[1], "max_bytes": budgets[2] << 20,
	}
	_session = TerraportSession.new(CLIENT, wanted, _CREDIT_BYTES, budgets[3] << 20, token)
	_session.opened.connect(_on_opened)
	_session.planned.connect(_on_planned)
	_session.payload_received.connect(_on_payload_received)
	_session.inner_completed.connect(_present)
	_session.completed.connect(_on_completed)
	_session.superseded.connect(_on_superseded)
	_session.refused.connect(_on_refused)
	_session.failed.connect(func(code: String, text: String) -> void: _refusal = [code, text])
	_session.picked.connect(_on_picked)
	_session.noticed.connect(_on_noticed)
	_session.evicted.connect(func(segment: TerraportSegment) -> void: segment.instance.queue_free())
	_shader = _SHADER
	if lit:
		_shader = Shader.new()
		_shader.code = _SHADER.code.replace("unshaded, ", "")
	_attempt = 0
	_connect_to_service()


func close() -> void:
	if _session == null:
		return
	if _socket != null:
		if _session.is_open:
			_socket.put_packet(TerraportWire.encode({"type": "bye"}))
		_socket.close()
	for job: Job in _running:
		WorkerThreadPool.wait_for_task_completion(job.task)
	for instance: Node in _instances():
		instance.queue_free()
	_session = null
	_socket = null
	_base = null
	_base_version = ""
	_opened_version = ""
	_retry_at_s = INF
	_welcomed_at_s = INF
	_standing = []
	manifest = {}
	hidden_faces = PackedByteArray()
	for table: Variant in [_waiting, _running, _drawn, _numbers, _visits, _places, _deadlines,
			_offer, _prefetch]:
		table.clear()
	_set_link(Link.CLOSED)


## Full detail around a place; supersedes any landing that is not shown yet. With
## [param inner_m], what lies within may be shown first once [param deadline_s] have passed.
## Returns its number in the signals, or 0 where nothing is open.
func land(place: Vector3, radius := 0.0, inner_m := 0.0, deadline_s := 0.0) -> int:
	if _session == null:
		return 0
	var wanted_m := radius if radius > 0.0 else radius_m
	var ring_m := _COARSE_RADII * wanted_m if shows_coarse else 0.0
	var local: Array = [to_local(place), wanted_m, ring_m]
	var landing := _land(local, inner_m)
	if deadline_s > 0.0:
		_deadlines[landing] = _now_s() + deadline_s
	# A place that was shown before is shown again at once if all of it is in memory (4, rule 10).
	var visit: Array = _visits.get(local, [])
	if not visit.is_empty() and _session.has_all(visit[0]):
		_present(landing, visit[0], visit[1])
	return landing


## Prefetch what a landing there needs, while the user points there. Call it as often as you like.
func prefetch(place: Vector3, radius := 0.0) -> void:
	_prefetch = [to_local(place), radius if radius > 0.0 else radius_m]


## Show the landing of [signal presentable]. Returns false if there is none.
func show_landing() -> bool:
	if _offer.is_empty() or not _has_base():
		return false
	var offer := _offer
	_offer = []
	_swap(offer[0], offer[1], offer[2])
	return true


## Return the first hit of a ray with what is shown: position, normal, segment (-1 for the base);
## empty without a hit. Exact and immediate, without colliders.
func cast_ground(from: Vector3, direction: Vector3, max_m := 100000.0) -> Dictionary:
	var origin := to_local(from)
	var along := (global_basis.inverse() * direction).normalized()
	var nearest := {}
	var nearest_m := max_m
	if _base != null:
		var hit := _first_base_hit(origin, along)
		if not hit.is_empty() and origin.distance_to(hit.position) <= nearest_m:
			nearest_m = origin.distance_to(hit.position)
			nearest = hit.merged({"segment": -1})
	for key: int in _drawn:
		var hit := _session.segment(key).intersect_ray(origin, along)
		if not hit.is_empty() and origin.distance_to(hit.position) <= nearest_m:
			nearest_m = origin.distance_to(hit.position)
			nearest = hit.merged({"segment": _numbers[key]})
	return {} if nearest.is_empty() else {
		"position": to_global(nearest.position),
		"normal": global_basis * nearest.normal,
		"segment": nearest.segment,
	}


## Return the ground below a point, or else the lowest above it; as [method cast_ground].
func ground_at(place: Vector3) -> Dictionary:
	var below := cast_ground(place + 0.01 * Vector3.UP, Vector3.DOWN)
	return below if not below.is_empty() else cast_ground(place, Vector3.UP)


## Ask the service what full detail has along a ray, loaded or not: height_m, region, label,
## attributes. Answered by [signal picked]. Returns the request's number, 0 where nothing is open.
func pick(from: Vector3, direction := Vector3.DOWN) -> int:
	if _session == null:
		return 0
	var along := global_basis.inverse() * direction
	return _session.pick(_doubles(to_local(from)), _doubles(along))


## Fetch a file that the manifest links to: [code]regions[/code] or [code]labels[/code]
## (spec/scene-format.md, section 11). Empty if it cannot be fetched.
func fetch_json(name: String) -> Dictionary:
	if name not in manifest.get("links", {}):
		return {}
	return _parsed(await _fetch(_server_url() + manifest.links[name]))


## Fetch the regions that have a name, the largest first: label, region, position, radius_m. Land at
## a position to see its region.
func places() -> Array[Dictionary]:
	var regions: Array = (await fetch_json("regions")).get("regions", [])
	var names := {}
	for row: Dictionary in (await fetch_json("labels")).get("labels", []):
		names[row.stable_id] = row.label
	var found: Array[Dictionary] = []
	for region: Dictionary in regions:
		var label: Variant = names.get(region.get("stable_id"), region.get("label"))
		var view: Dictionary = region.get("place", {})
		var stands: Array = view.get("position", region.get("centroid", []))
		if label is String and label != "" and stands.size() == 3:
			found.append({
				"label": label, "region": int(region.id), "area_m2": region.get("area_m2", 0.0),
				"position": to_global(Vector3(stands[0], stands[1], stands[2])),
				"radius_m": view.get("radius_m", radius_m),
			})
	found.sort_custom(
			func(one: Dictionary, other: Dictionary) -> bool: return one.area_m2 > other.area_m2)
	return found


## Return the payload bytes received, and those received although they were in memory.
func stats() -> Dictionary:
	return {} if _session == null else {
		"received_bytes": _session.received_bytes,
		"repeated_bytes": _session.repeated_bytes,
	}


# ---- connection


func _set_link(state: Link) -> void:
	if link != state:
		link = state
		link_changed.emit(state)


# The manifest comes first: its HTTP status says why a service refuses access.
func _connect_to_service() -> void:
	var session := _session
	_retry_at_s = INF
	_set_link(Link.CONNECTING)
	var answer: Array = await _fetch(url, _CONNECT_S)
	if session != _session:
		return
	var read := _parsed(answer)
	if read.is_empty():
		if answer[0] in _FINAL_STATUSES:
			_fail(_FINAL_STATUSES[answer[0]], "got HTTP status %d, expected 200" % answer[0])
		else:
			_wait_and_retry()
		return
	var is_other: bool = not manifest.is_empty() and manifest.version != read.version
	manifest = read
	if is_other:
		_leave_version()
		if session != _session:
			return
	_refusal.clear()
	_socket = WebSocketPeer.new()
	_socket.supported_protocols = [TerraportWire.SUBPROTOCOL]
	_socket.inbound_buffer_size = _INBOUND_BYTES
	_socket.outbound_buffer_size = _OUTBOUND_BYTES
	_socket.heartbeat_interval = _PING_PERIOD_S
	_socket.connect_to_url("ws" + url.trim_prefix("http").trim_suffix("/") + "/stream")
	_connect_by_s = _now_s() + _CONNECT_S
	_session.connection_opened()
	_load_base()


func _receive() -> void:
	_socket.poll()
	while _socket != null and _socket.get_available_packet_count() > 0:
		var error := _session.receive(_socket.get_packet())
		if error != "":
			_socket.close(4400, "malformed")
			_fail("malformed", error)
	if _socket == null:
		return
	if _socket.get_ready_state() == WebSocketPeer.STATE_CLOSED:
		var code := _socket.get_close_code()
		if code not in _FINAL_CLOSE_CODES:
			_wait_and_retry()
		elif _refusal.is_empty():
			_fail("closed", "the service closed the connection with %d" % code)
		else:
			_fail(_refusal[0], _refusal[1])
	elif not _session.is_open and _now_s() > _connect_by_s:
		_socket.close()
		_wait_and_retry()


func _send() -> void:
	var now_s := _now_s()
	if not _prefetch.is_empty() and _session.is_open and now_s >= _next_prefetch_s:
		var ring_m: float = _COARSE_RADII * _prefetch[1] if shows_coarse else 0.0
		_session.prefetch(_doubles(_prefetch[0]), _prefetch[1], ring_m)
		_prefetch.clear()
		_next_prefetch_s = now_s + _PREFETCH_PERIOD_S
	if now_s < _next_send_s and _session.is_open:
		return
	var messages := _session.messages_to_send()
	for message: Dictionary in messages:
		_socket.put_packet(TerraportWire.encode(message))
	_next_send_s = now_s + messages.size() / _max_messages_per_s


func _wait_and_retry() -> void:
	_drop_socket()
	# A service that accepts and closes at once is not asked again and again.
	if _now_s() - _welcomed_at_s >= _STABLE_S:
		_attempt = 0
	_welcomed_at_s = INF
	var wait_s := minf(_FIRST_WAIT_S * 2.0 ** _attempt, _MAX_WAIT_S) * randf_range(0.5, 1.0)
	_retry_at_s = _now_s() + (_first_wait_s if _first_wait_s >= 0.0 else wait_s)
	_first_wait_s = -1.0
	_attempt += 1
	_set_link(Link.WAITING)


func _fail(code: String, message: String) -> void:
	_drop_socket()
	_set_link(Link.CLOSED)
	failed.emit(code, message)


func _drop_socket() -> void:
	_socket = null
	_session.connection_lost()


# Return status and body of a GET; status 0 without an answer.
func _fetch(address: String, timeout_s := 0.0) -> Array:
	var request := HTTPRequest.new()
	request.timeout = timeout_s
	request.max_redirects = 0 # The token goes to this server alone.
	add_child(request)
	var headers: PackedStringArray = [] if token == "" else ["Authorization: Bearer " + token]
	var answer: Array = [HTTPRequest.RESULT_CANT_CONNECT, 0, [], PackedByteArray()]
	if request.request(address, headers) == OK:
		answer = await request.request_completed
	request.queue_free()
	return [answer[1] if answer[0] == HTTPRequest.RESULT_SUCCESS else 0, answer[3]]


static func _parsed(answer: Array) -> Dictionary:
	if answer[0] != 200:
		return {}
	var read: Variant = JSON.parse_string(answer[1].get_string_from_utf8())
	return read if read is Dictionary else {}


func _server_url() -> String:
	return url.left(url.rfind("/scenes/") + 1)


static func _now_s() -> float:
	return Time.get_ticks_usec() / 1e6


static func _doubles(vector: Vector3) -> PackedFloat64Array:
	return [vector.x, vector.y, vector.z]


# ---- signals of the session


func _on_opened(scene: Dictionary, limits: Dictionary) -> void:
	_max_messages_per_s = limits.max_messages_per_s
	_welcomed_at_s = _now_s()
	if scene.version != manifest.version: # A version was published between the two answers.
		_socket.close()
		_wait_and_retry()
		return
	_set_link(Link.OPEN)
	_announce()


func _announce() -> void:
	if link == Link.OPEN and _has_base() and _opened_version != _base_version:
		_opened_version = _base_version
		opened.emit()
		if land_on_open and _places.is_empty() and _standing.is_empty():
			land(to_global(landing_at_start))


# Another version was published: nothing of the one before is drawn on its base, or with its scales.
func _leave_version() -> void:
	var session := _session
	for job: Job in _waiting:
		job.attributes = manifest.attributes
	for job: Job in _running:
		job.is_stale = true
	_visits.clear()
	_swap(0, PackedInt64Array(), PackedByteArray())
	if attribute != "": # Its scale may have changed.
		session.forget()
	if _places.is_empty() and not _standing.is_empty():
		_land(_standing)
	_offer.clear()


# Land at a place with its radii, in the scene's frame. What was not shown yet never is.
func _land(place: Array, inner_m := 0.0) -> int:
	var offer := _offer
	_offer = []
	var landing := _session.land(_doubles(place[0]), place[1], inner_m, place[2])
	_places[landing] = place
	# A landing that is complete is over for the session.
	if not offer.is_empty() and offer[0] not in _places:
		superseded.emit(offer[0], landing)
	return landing


func _on_planned(landing: int, plan: Dictionary) -> void:
	var rows: PackedByteArray = plan.show
	for at: int in range(0, rows.size(), TerraportWire.ROW_BYTES):
		var is_coarse := rows[at + 24] & TerraportWire.ROW_IS_COARSE
		_numbers[rows.decode_s64(at)] = \
				rows.decode_u32(at + 8) + (int(manifest.counts.segments) if is_coarse else 0)
	planned.emit(landing, {
		"segments": rows.size() / TerraportWire.ROW_BYTES,
		"effective_radius_m": plan.effective_radius_m,
		"omitted": plan.omitted, "omitted_by": plan.get("omitted_by", ""),
	})


func _on_payload_received(key: int, payload: PackedByteArray) -> void:
	_waiting.append(_job(key, payload))


func _on_completed(landing: int, keys: PackedInt64Array, bits: PackedByteArray) -> void:
	_standing = _places[landing]
	_visits.erase(_standing)
	_visits[_standing] = [keys, bits]
	if _visits.size() > _MAX_VISITS:
		_visits.erase(_visits.keys()[0])
	_forget_landing(landing)
	_present(landing, keys, bits)


func _on_superseded(landing: int, by: int) -> void:
	_forget_landing(landing)
	superseded.emit(landing, by)


func _on_refused(landing: int, code: String, message: String) -> void:
	_forget_landing(landing)
	refused.emit(landing, code, message)


func _forget_landing(landing: int) -> void:
	_places.erase(landing)
	_deadlines.erase(landing)
	if not _offer.is_empty() and _offer[0] == landing:
		_offer.clear()


func _on_picked(request: int, hit: Dictionary) -> void:
	if not hit.is_empty():
		hit["position"] = to_global(Vector3(hit.position[0], hit.position[1], hit.position[2]))
		hit["normal"] = global_basis * Vector3(hit.normal[0], hit.normal[1], hit.normal[2])
	picked.emit(request, hit)


func _on_noticed(notice: Dictionary) -> void:
	if "reconnect_after_ms" in notice:
		_first_wait_s = notice.reconnect_after_ms / 1000.0


# ---- decoding, uploads, the swap


func _job(key: int, payload: PackedByteArray) -> Job:
	var job := Job.new()
	job.key = key
	job.payload = payload
	job.attributes = manifest.attributes
	job.attribute = attribute
	return job


func _decode_and_upload() -> void:
	var end_us := Time.get_ticks_usec() + int(1000.0 * frame_budget_ms)
	while not _running.is_empty() and Time.get_ticks_usec() < end_us and _running[0].is_done():
		var job: Job = _running.pop_front()
		if job.is_stale:
			job.is_stale = false
			job.attributes = manifest.attributes
			_waiting.append(job)
		elif job.result.error == "":
			_upload(job.result)
			job.result.instance.visible = false
			_session.accept(job.key, job.result)
		else:
			push_warning("terraport: segment %x: %s" % [job.key, job.result.error])
			_session.reject(job.key)
	# In an engine without threads add_task() runs the task: the budget then limits decoding.
	while not _waiting.is_empty() and _running.size() < _MAX_TASKS \
			and Time.get_ticks_usec() < end_us:
		var job: Job = _waiting.pop_front()
		job.start()
		_running.append(job)


func _upload(segment: TerraportSegment) -> void:
	var mesh := ArrayMesh.new()
	mesh.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, segment.mesh_arrays())
	var material := ShaderMaterial.new()
	material.shader = _shader
	material.set_shader_parameter("look", look)
	material.set_shader_parameter("relief", 0.0 if lit else 1.0)
	material.set_shader_parameter("region", segment.region)
	material.set_shader_parameter("has_facts", not segment.facts.is_empty())
	material.set_shader_parameter("has_tint", not segment.colours.is_empty())
	for facts: Dictionary in manifest.attributes:
		if facts.name == attribute and facts.min != null:
			material.set_shader_parameter("attribute_range", Vector2(facts.min, facts.max))
	if segment.image != null:
		material.set_shader_parameter("has_map", true)
		material.set_shader_parameter("map", ImageTexture.create_from_image(segment.image))
		material.set_shader_parameter("is_map_of_points", manifest.textures.source == "vertex")
		segment.image = null
	segment.instance = MeshInstance3D.new()
	segment.instance.mesh = mesh
	segment.instance.material_override = material
	add_child(segment.instance)
	if collision_layer != 0 and segment != _base:
		var shape := CollisionShape3D.new()
		shape.shape = ConcavePolygonShape3D.new()
		shape.shape.set_faces(segment.corners())
		var body := StaticBody3D.new()
		body.collision_layer = collision_layer
		body.add_child(shape)
		segment.instance.add_child(body)
		segment.instance.process_mode = PROCESS_MODE_DISABLED # Takes the body out of the space.


func _load_base() -> void:
	var version: String = manifest.version
	if _base_version == version:
		return
	var session := _session
	var answer: Array = await _fetch(_server_url() + manifest.links.base)
	if session != _session or version != manifest.version:
		return
	if answer[0] != 200:
		_wait_and_retry()
		return
	var job := _job(0, answer[1])
	job.max_side = _MAX_BASE_IMAGE
	job.start()
	while not job.is_done():
		await Engine.get_main_loop().process_frame
	if session != _session or version != manifest.version:
		return
	if job.result.error != "":
		_fail("damaged_base", job.result.error)
		return
	if _base != null:
		_base.instance.queue_free()
	_base = job.result
	_base.separate_faces()
	_upload(_base)
	_base.instance.material_override.set_shader_parameter("push_m", manifest.hand_off.deviation_m)
	_base_version = version
	_hide_base_faces(hidden_faces)
	_announce()
	if not _offer.is_empty():
		_present.callv(_offer)


func _has_base() -> bool:
	return _base_version == manifest.get("version")


# Hidden faces are those of one version's base: without it the landing waits.
func _present(landing: int, keys: PackedInt64Array, bits: PackedByteArray) -> void:
	_offer = [landing, keys, bits]
	if not _has_base():
		return
	if auto_show:
		show_landing()
	else:
		presentable.emit(landing)


# Everything that is drawn changes here, between two frames.
func _swap(landing: int, keys: PackedInt64Array, bits: PackedByteArray) -> void:
	for key: int in _drawn:
		_set_shown(_session.segment(key).instance, false)
	_drawn.clear()
	for key: int in keys:
		var instance := _session.segment(key).instance
		instance.material_override.set_shader_parameter("segment", _numbers[key])
		_set_shown(instance, true)
		_drawn[key] = true
	_session.drawn = _drawn
	_hide_base_faces(bits)
	shown.emit(landing)


static func _set_shown(instance: MeshInstance3D, is_shown: bool) -> void:
	instance.visible = is_shown
	instance.process_mode = PROCESS_MODE_INHERIT if is_shown else PROCESS_MODE_DISABLED


# The shader reads one bit per face from a texture.
func _hide_base_faces(bits: PackedByteArray) -> void:
	hidden_faces = bits
	if _base == null:
		return
	var mask := bits.duplicate()
	var height := maxi(1, ceili(mask.size() / float(_MASK_WIDTH)))
	mask.resize(_MASK_WIDTH * height)
	var image := Image.create_from_data(_MASK_WIDTH, height, false, Image.FORMAT_R8, mask)
	var material: ShaderMaterial = _base.instance.material_override
	material.set_shader_parameter("hidden", ImageTexture.create_from_image(image))
	material.set_shader_parameter("has_hidden", not bits.is_empty())


func _first_base_hit(origin: Vector3, along: Vector3) -> Dictionary:
	var hit := _base.intersect_ray(origin, along)
	while not hit.is_empty():
		var face: int = hit.face_index
		if face >> 3 >= hidden_faces.size() or hidden_faces[face >> 3] >> (face & 7) & 1 == 0:
			return hit
		hit = _base.intersect_ray(hit.position + 0.001 * along, along)
	return {}


func _instances() -> Array[Node]:
	return get_children().filter(func(child: Node) -> bool: return child is MeshInstance3D \
			and child.material_override is ShaderMaterial \
			and child.material_override.shader == _shader)


func _set_parameter(name: String, value: Variant) -> void:
	for instance: MeshInstance3D in _instances():
		instance.material_override.set_shader_parameter(name, value)
