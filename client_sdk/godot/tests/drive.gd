extends Node3D
## Lets a page drive the addon: godotDriver(method, arguments in JSON, resolve).

const CORPORA := preload("res://tests/corpora.gd")

var terrain: TerraportTerrain
var events: Array = []
var _callback: JavaScriptObject


func _ready() -> void:
	_callback = JavaScriptBridge.create_callback(_on_call)
	JavaScriptBridge.get_interface("window").godotDriver = _callback


## Call a method of corpora.gd.
func corpus(method: String, arguments: Array) -> Variant:
	return CORPORA.new().callv(method, arguments)


## Open a scene; waits until its base is shown.
func open(properties: Dictionary) -> String:
	if terrain != null:
		terrain.free()
	events.clear()
	terrain = TerraportTerrain.new()
	terrain.open_on_ready = false
	terrain.land_on_open = false
	for name: String in properties:
		terrain.set(name, properties[name])
	terrain.custom_budgets[3] = 0
	terrain.shown.connect(func(landing: int) -> void: _note("shown", landing))
	terrain.presentable.connect(func(landing: int) -> void: _note("presentable", landing))
	terrain.superseded.connect(func(landing: int, by: int) -> void: _note("superseded", [landing, by]))
	terrain.refused.connect(
			func(_landing: int, code: String, _text: String) -> void: _note("refused", code))
	terrain.failed.connect(func(code: String, text: String) -> void: _note("failed", [code, text]))
	terrain.link_changed.connect(func(state: int) -> void: _note("link", state))
	terrain.picked.connect(func(_request: int, hit: Dictionary) -> void: _note("picked", hit))
	terrain.planned.connect(func(landing: int, facts: Dictionary) -> void: _note("planned", facts))
	add_child(terrain)
	terrain.open()
	var first: String = await _first([terrain.opened, terrain.failed])
	return first


## Land, and wait until that is shown.
func land(x: float, y: float, z: float, radius_m: float) -> Dictionary:
	var frame := Engine.get_process_frames()
	var landing := terrain.land(Vector3(x, y, z), radius_m)
	var told := await until_shown(landing)
	told["frames"] = Engine.get_process_frames() - frame
	return told


func begin_landing(
		x: float, y: float, z: float, radius_m: float, inner_m := 0.0, deadline_s := 0.0
) -> int:
	return terrain.land(Vector3(x, y, z), radius_m, inner_m, deadline_s)


func show_landing() -> bool:
	return terrain.show_landing()


## Wait until a landing is shown, the inner part or the whole for the first time or the second.
func until_shown(landing: int, times := 1) -> Dictionary:
	while events.filter(func(one: Array) -> bool:
			return one[0] == "shown" and one[1] == landing).size() < times:
		await get_tree().process_frame
	return state().merged({"landing": landing})


## Fetch ahead, and wait until half a second has brought nothing; returns the bytes received so far.
func prefetch(x: float, y: float, z: float, radius_m: float) -> int:
	var before := -1
	terrain.prefetch(Vector3(x, y, z), radius_m)
	while before != terrain.stats().received_bytes:
		before = terrain.stats().received_bytes
		await get_tree().create_timer(0.5).timeout
	return before


func pick(x: float, y: float, z: float) -> Dictionary:
	terrain.pick(Vector3(x, y, z))
	var answer: Array = await terrain.picked
	var hit: Dictionary = answer[1]
	hit["position"] = [hit.position.x, hit.position.y, hit.position.z]
	return hit


func places() -> Array:
	return (await terrain.places()).map(func(place: Dictionary) -> Array:
		return [place.label, place.region, place.position.x, place.position.y, place.position.z,
				place.radius_m])


func set_look(look: int) -> void:
	terrain.look = look


func state() -> Dictionary:
	var meshes := terrain.get_children().filter(
			func(child: Node) -> bool:
				return child is MeshInstance3D and not child.is_queued_for_deletion())
	return {
		"visible": Array(terrain.visible_segments), "hidden": terrain.hidden_faces.hex_encode(),
		"stats": terrain.stats(), "events": events, "link": terrain.link,
		"meshes": meshes.filter(func(one: Node) -> bool: return one.visible).size(),
		"instances": meshes.size(),
	}


func cast(rays: Array) -> Array:
	return rays.map(func(ray: Array) -> Array:
		var hit := terrain.cast_ground(Vector3(ray[0], ray[1], ray[2]), Vector3(ray[3], ray[4], ray[5]))
		return [] if hit.is_empty() else [hit.position.x, hit.position.y, hit.position.z, hit.segment])


## The same by the engine's physics: positions alone.
func collide(rays: Array) -> Array:
	await get_tree().physics_frame
	return rays.map(func(ray: Array) -> Array:
		var from := Vector3(ray[0], ray[1], ray[2])
		var query := PhysicsRayQueryParameters3D.create(
				from, from + 1000.0 * Vector3(ray[3], ray[4], ray[5]))
		var hit := get_world_3d().direct_space_state.intersect_ray(query)
		return [] if hit.is_empty() else [hit.position.x, hit.position.y, hit.position.z])


## Open the example at another address, and go to a place as by a click.
func walk_example(url: String, x: float, z: float) -> Dictionary:
	if terrain != null:
		terrain.free()
	var example: Node3D = preload("res://example/first_landing.tscn").instantiate()
	var walker: Camera3D = example.get_node("Walker")
	terrain = example.get_node("Terrain")
	terrain.url = url
	terrain.landing_at_start = Vector3(30, 1, 30)
	add_child(example)
	await terrain.shown
	var told := {"first": Array(terrain.visible_segments), "frames": []}
	terrain.shown.connect(
			func(_landing: int) -> void: told.frames.append(Engine.get_process_frames()))
	await walker.go_to(terrain.ground_at(Vector3(x, 100, z)).position)
	told.frames.append(walker.moved_frame)
	told["second"] = Array(terrain.visible_segments)
	told["eye"] = [walker.position.x, walker.position.y, walker.position.z]
	told["ground_m"] = terrain.ground_at(walker.position).position.y
	example.free()
	terrain = null
	return told


## A picture from an eye, as PNG in base64; yaw 0 looks north.
func look(x: float, y: float, z: float, yaw_deg: float, pitch_deg: float) -> String:
	var camera: Camera3D = $Camera
	camera.position = Vector3(x, y, z)
	camera.rotation_degrees = Vector3(pitch_deg, -yaw_deg, 0)
	await get_tree().process_frame
	await RenderingServer.frame_post_draw
	return Marshalls.raw_to_base64(get_viewport().get_texture().get_image().save_png_to_buffer())


func _note(name: String, facts: Variant) -> void:
	events.append([name, facts, Engine.get_process_frames()])


func _first(signals: Array[Signal]) -> String:
	var fired: Array = []
	for one: Signal in signals:
		one.connect(func(..._arguments: Array) -> void: fired.append(one.get_name()), CONNECT_ONE_SHOT)
	while fired.is_empty():
		await get_tree().process_frame
	return fired[0]


func _on_call(given: Array) -> void:
	var resolve: JavaScriptObject = given[2]
	var result: Variant = await callv(given[0], JSON.parse_string(given[1]))
	resolve.call("call", null, JSON.stringify(result, "", true, true))
