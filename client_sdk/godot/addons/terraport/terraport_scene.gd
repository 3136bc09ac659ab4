# A scene that a terraport service streams: its base, and full detail where somebody has landed.
#
# Put the node into a world, set `scene_url`, and land. The node is the scene's origin: x is east, y up, -z north, a metre is 1.
# Positions are of the world; the node may be moved and turned, but its scale must stay 1.
class_name TerraportScene
extends Spatial

# The base is here; landings are asked for (one that was asked for before is now).
signal opened(facts)
# What a landing will load, and what a budget left out.
signal planned(facts)
# Every byte of it is here; or its deadline passed, and the inner part can be shown.
signal landed(facts)
signal degraded(facts)
# With `auto_show` off: `show_landing` would show it.
signal presentable(facts)
# In the frame in which what is drawn changes.
signal shown(facts)
# A newer landing took the place of one that was not ready.
signal superseded(facts)
# What an aim asked for is here.
signal prefetched(facts)
# Answer to `pick`.
signal picked(facts)
# connecting, open, waiting to connect again, closed for good.
signal link_changed(facts)
# A group that visits the scene together: who is in it has changed (`group`, null without a seat); its guide lands it at
# `position` within `radius_m`; everybody is there, or nobody waits any longer; a join or gather was refused.
signal group_changed(facts)
signal group_called(facts)
signal group_gathered(facts)
signal group_refused(facts)
# With a code of the wire protocol, or of the client; what is shown stays.
signal failed(facts)

enum Device { DESKTOP, HEADSET, CUSTOM }
enum Look { COLOUR, REGIONS, SEGMENTS, ATTRIBUTE, SLOPE }

const CLIENT := preload("res://addons/terraport/terraport_client.gdns")
const GROUND := preload("res://addons/terraport/ground.shader")
const FAR_M := 100000.0
# Triangles, segments, MiB of payload a landing, MiB kept in memory, decoding threads.
const BUDGETS := {
	Device.DESKTOP: [3000000, 2048, 128, 96, 2],
	Device.HEADSET: [900000, 512, 32, 48, 2],
}
const SIGNALS := {"link": "link_changed", "ready": "landed"}

# http(s)://host/scenes/ID, or a server's address where it has one scene.
export var scene_url := ""
# What `terraport token` gave. It is saved with the scene in the clear: set it at run time instead.
export var token := ""
# Of a landing that names none, metres.
export(float, 1.0, 500.0) var radius_m := 60.0
export var open_on_ready := true
# Land at `landing_at_start` (scene frame) as soon as the scene is open.
export var land_on_open := true
export var landing_at_start := Vector3.ZERO
# Show a landing as soon as it can be; else `show_landing` does, in the dark of a fade for instance.
export var auto_show := true setget set_auto_show
# Around full detail show a ring of the coarser level, to three times the radius, where the scene has one; counts for the landings
# from then on. Budgets count both; where there is no room for both the ring gives way.
export var shows_coarse := true setget set_shows_coarse
# Land where the guide of the group does; else the group is told that this one does not come.
export var follows_group := true setget set_follows_group
export(Look) var look := Look.COLOUR setget set_look
# Name of an attribute of the survey; its values come with what is loaded from the next `open` on.
export var attribute := ""
# Lit by the engine's lights; else by the shape alone, as on a map.
export var lit := false
export var cast_shadows := false
export(int, LAYERS_3D_RENDER) var layers := 1
# Within so many metres of the last landing what is shown is a static body too; 0 for none. `cast_ground` needs none.
export(float, 0.0, 100.0) var collider_radius_m := 0.0
export(int, LAYERS_3D_PHYSICS) var collision_layer := 1
# Milliseconds that one frame gives to uploads.
export(float, 0.2, 20.0) var frame_budget_ms := 2.0
export(Device) var device := Device.DESKTOP
# Of Device.CUSTOM.
export var max_triangles := 3000000
export var max_segments := 2048
export var max_payload_mib := 128
export var cache_mib := 96
export var spare_mesh_mib := 128
export var decode_threads := 2

var _client: Reference = null
var _shader: Shader = null


func _ready() -> void:
	set_notify_transform(true)
	if open_on_ready and scene_url != "":
		open()


func _exit_tree() -> void:
	close()


# Open `scene_url`. What was open is closed.
func open() -> void:
	close()
	_client = CLIENT.new()
	_shader = GROUND
	if lit:
		_shader = Shader.new()
		_shader.code = GROUND.code.replace("unshaded, ", "")
	var budgets: Array = BUDGETS.get(device, [max_triangles, max_segments, max_payload_mib, cache_mib, decode_threads])
	var settings := {
		"url": scene_url, "token": token, "attribute": attribute,
		"scenario": get_world().scenario, "space": get_world().space, "shader": _shader.get_rid(),
		"transform": global_transform, "visible": is_visible_in_tree(),
		"cast_shadows": cast_shadows, "layers": layers,
		"collider_radius_m": collider_radius_m, "collider_layer": collision_layer,
		"max_triangles": budgets[0], "max_segments": budgets[1], "max_payload_mib": budgets[2],
		"cache_mib": budgets[3], "decode_threads": budgets[4], "spare_mesh_mib": spare_mesh_mib,
		"auto_show": auto_show, "shows_coarse": shows_coarse,
	}
	for name in settings:
		_client.configure(name, settings[name])
	_client.open()
	_client.set_follows_group(follows_group)
	_client.set_parameter("relief", 0.0 if lit else 1.0)
	_client.set_parameter("ramp", _ramp().get_rid())
	set_look(look)


func close() -> void:
	if _client != null:
		_client.close()
		_client = null


func is_open() -> bool:
	return _client != null and _client.manifest() != null


# Full detail around a place. Supersedes any landing that is not ready. `inner_m` and `deadline_ms`: past the deadline the inner
# part may be shown first. Returns its number in the signals; 0 before the scene is open, when the newest one is kept.
func land(position: Vector3, radius := 0.0, inner_m := 0.0, deadline_ms := 0) -> int:
	if _client == null:
		return 0
	return _client.land(to_local(position), radius if radius > 0.0 else radius_m, inner_m, deadline_ms)


# Somebody points there: what a landing needs comes ahead. Call it as often as you like.
func aim(position: Vector3, radius := 0.0) -> void:
	if _client != null:
		_client.aim(to_local(position), radius if radius > 0.0 else radius_m)


# Swap now. False where nothing is presentable.
func show_landing() -> bool:
	return _client != null and _client.show()


# Where a ray meets what is shown: {position, normal, segment (-1: base)}, or null. Exact, at once, without colliders.
func cast_ground(from: Vector3, direction: Vector3, max_m := FAR_M):
	if _client == null:
		return null
	var hit = _client.cast(to_local(from), global_transform.basis.xform_inv(direction.normalized()), max_m)
	return _to_world(hit)


# The ground on the vertical of a point: the highest not above it, else the lowest above it. As `cast_ground`, or null.
func ground_at(position: Vector3):
	var below = cast_ground(position + 0.01 * Vector3.UP, Vector3.DOWN)
	return below if below != null else cast_ground(position, Vector3.UP)


# Ask what full detail has along a ray, loaded or not: height, region, label, attributes. Answered by `picked`.
func pick(from: Vector3, direction := Vector3.DOWN) -> int:
	if _client == null:
		return -1
	return _client.pick(to_local(from), global_transform.basis.xform_inv(direction))


# Take a seat in a group of this scene (1 to 64 of A-Z a-z 0-9 _ . ~ -); one held before is left. The guide lands the group.
# False before the scene is open. Names and groups come from other people: show them as such.
func join_group(name: String, as_guide := false, own_name := "") -> bool:
	return _client != null and _client.join_group(name, as_guide, own_name)


func leave_group() -> void:
	if _client != null:
		_client.leave_group()


# Land everybody there, as the guide. False without a seat.
func gather(position: Vector3, radius := 0.0) -> bool:
	return _client != null and _client.gather(to_local(position), radius if radius > 0.0 else radius_m)


# Land where the group is, though that was not followed. 0 where it is nowhere.
func go_to_group() -> int:
	return _client.go_to_group() if _client != null else 0


# Name, own number and role, members, and who was there of the newest landing; null without a seat.
func group():
	return _client.group() if _client != null else null


# Connect now, perhaps with another token.
func reconnect(new_token := "") -> void:
	if new_token != "":
		token = new_token
	if _client != null:
		_client.reconnect(new_token)


# How the newest landing stands: phase, fraction, radii, missing, refusal.
func status() -> Dictionary:
	return _client.status() if _client != null else {}


# Counts, and the longest update since they were taken last.
func take_stats() -> Dictionary:
	return _client.take_stats() if _client != null else {}


# Name, bounds, attributes, CRS; null before the scene is open.
func manifest():
	return _client.manifest() if _client != null else null


func regions() -> Array:
	return _client.regions() if _client != null else []


# Named regions as places to go to, by name, the largest of each first: label, region, area_m2, position, heading_deg (null
# where nobody chose), radius_m, is_view.
func places() -> Array:
	var found: Array = _client.places() if _client != null else []
	for place in found:
		place["position"] = to_global(place["position"])
	return found


# Land at the place of that name, whatever its case, with the radius that shows it. The landing's number, -1 where there is none.
func land_at_place(label: String) -> int:
	var wanted := label.strip_edges().to_lower()
	for place in places():
		if place.label.to_lower() == wanted:
			return land(place.position, place.radius_m)
	return -1


# Coarser pieces that a region (a pick's) is part of, finest first: cost, regions, area_m2, label.
func coarser_pieces(region: int) -> Array:
	return _client.coarser_pieces(region) if _client != null else []


# Segments shown, ascending; and what is drawn as one text: segments, their hash, hidden faces of the base, their hash. It is
# the viewer's where the same is drawn, but for the last part: the base's faces stand in an order of their own here.
func visible_segments() -> PoolIntArray:
	return _client.visible() if _client != null else PoolIntArray()


func visible_digest() -> String:
	return _client.digest() if _client != null else ""


# East, north, height in the survey's CRS: three floats, since a Vector3 has 24 bits.
func world_to_survey(position: Vector3) -> Array:
	return _client.to_survey(to_local(position)) if _client != null else []


func survey_to_world(east: float, north: float, height: float) -> Vector3:
	return to_global(_client.from_survey(east, north, height)) if _client != null else Vector3.ZERO


func set_auto_show(value: bool) -> void:
	auto_show = value
	if _client != null:
		_client.set_auto_show(value)


func set_shows_coarse(value: bool) -> void:
	shows_coarse = value
	if _client != null:
		_client.set_shows_coarse(value)


func set_follows_group(value: bool) -> void:
	follows_group = value
	if _client != null:
		_client.set_follows_group(value)


func set_look(value: int) -> void:
	look = value
	if _client == null:
		return
	_client.set_parameter("look", look)
	var manifest = _client.manifest()
	for facts in manifest.attributes if manifest != null else []:
		if facts.name == attribute and facts.min != null:
			_client.set_parameter("attribute_min", facts.min)
			_client.set_parameter("attribute_max", facts.max)


func _notification(what: int) -> void:
	if _client == null:
		return
	if what == NOTIFICATION_TRANSFORM_CHANGED:
		_client.set_transform(global_transform)
	elif what == NOTIFICATION_VISIBILITY_CHANGED:
		_client.set_visible(is_visible_in_tree())


func _process(_delta: float) -> void:
	if _client == null:
		return
	for event in _client.update(frame_budget_ms):
		var name: String = event[0]
		var facts: Dictionary = event[1]
		if name == "opened":
			set_look(look)
			if land_on_open and status().phase == "none":
				land(to_global(landing_at_start))
		if name == "picked":
			facts = _to_world(facts)
		elif name == "group_called":
			facts["position"] = to_global(facts["position"])
		emit_signal(SIGNALS.get(name, name), facts)
		# A listener may have closed the scene.
		if _client == null:
			return


func _to_world(facts):
	if facts != null and facts.has("position"):
		facts["position"] = to_global(facts["position"])
		facts["normal"] = global_transform.basis.xform(facts["normal"])
	return facts


var _ramp_texture: ImageTexture = null


# Dark blue to yellow, in even steps of lightness.
func _ramp() -> ImageTexture:
	if _ramp_texture == null:
		var gradient := Gradient.new()
		gradient.offsets = PoolRealArray([0.0, 0.25, 0.5, 0.75, 1.0])
		gradient.colors = PoolColorArray(
				[Color("#30275e"), Color("#3b6494"), Color("#3f9a88"), Color("#9bc55b"), Color("#f5e35c")])
		var image := Image.new()
		image.create(256, 1, false, Image.FORMAT_RGB8)
		image.lock()
		for at in 256:
			image.set_pixel(at, 0, gradient.interpolate(at / 255.0))
		image.unlock()
		_ramp_texture = ImageTexture.new()
		_ramp_texture.create_from_image(image, Texture.FLAG_FILTER)
	return _ramp_texture
