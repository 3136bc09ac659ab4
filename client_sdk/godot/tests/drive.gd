# Visits a scene step by step and writes down what came of it; tests/engines/godot.py says how.
#
#     TERRAPORT_STEPS=steps.json TERRAPORT_OUT=out.json godot3 --path client_sdk/godot -s res://tests/drive.gd
extends SceneTree

const TIMEOUT_MS := 60000

var scene: Spatial
var camera: Camera
var events := []
var results := []


func _init() -> void:
	call_deferred("run")


func run() -> void:
	var file := File.new()
	file.open(OS.get_environment("TERRAPORT_STEPS"), File.READ)
	var order: Dictionary = parse_json(file.get_as_text())
	file.close()
	OS.window_size = Vector2(order.width, order.height)
	OS.vsync_enabled = false
	VisualServer.set_default_clear_color(Color(1, 0, 1) if order.get("magenta", false) else Color(0.784, 0.843, 0.902))
	camera = Camera.new()
	camera.near = 0.1
	camera.far = 4000
	camera.fov = order.get("fov", 60.0)
	root.add_child(camera)
	scene = load("res://addons/terraport/terraport_scene.gd").new()
	scene.land_on_open = false
	for name in order.get("properties", {}):
		scene.set(name, order.properties[name])
	for name in ["opened", "planned", "landed", "degraded", "presentable", "shown", "superseded", "prefetched", "picked",
			"link_changed", "failed", "group_changed", "group_called", "group_gathered", "group_refused"]:
		scene.connect(name, self, "_note", [name])
	root.add_child(scene)
	var failure := ""
	for step in order.steps:
		var outcome = call("step_" + step[0], step)
		if outcome is GDScriptFunctionState:
			outcome = yield(outcome, "completed")
		if outcome is String:
			failure = "%s: %s" % [step, outcome]
			break
		results.append(outcome)
	scene.queue_free()
	yield(self, "idle_frame")
	var out := File.new()
	out.open(OS.get_environment("TERRAPORT_OUT"), File.WRITE)
	out.store_string(to_json({"events": events, "results": results, "failure": failure}))
	out.close()
	quit()


func _note(facts: Dictionary, name: String) -> void:
	var noted := facts.duplicate()
	for key in noted:
		if noted[key] is Vector3:
			noted[key] = [noted[key].x, noted[key].y, noted[key].z]
	noted["event"] = name
	noted["frame"] = Engine.get_frames_drawn()
	events.append(noted)


func count_of(name: String) -> int:
	var count := 0
	for event in events:
		count += int(event.event == name)
	return count


# Frames go by until there are more events of a name than `before`. Returns the last such event, or a text where none came.
func until_more(name: String, before: int, timeout_ms := TIMEOUT_MS):
	yield(self, "idle_frame")
	var end := OS.get_ticks_msec() + timeout_ms
	while count_of(name) <= before:
		if OS.get_ticks_msec() > end:
			return "no %s within %d ms; %s" % [name, timeout_ms, to_json(events.slice(events.size() - 4, events.size() - 1))]
		yield(self, "idle_frame")
	for at in range(events.size() - 1, -1, -1):
		if events[at].event == name:
			return events[at]


func vector(step: Array, at: int) -> Vector3:
	return Vector3(step[at], step[at + 1], step[at + 2])


# ["open"]: until it is, or cannot be.
func step_open(_step: Array):
	yield(self, "idle_frame")
	var end := OS.get_ticks_msec() + TIMEOUT_MS
	while count_of("opened") == 0:
		for event in events:
			if event.event == "failed" and event.final:
				return "refused: " + event.code
		if OS.get_ticks_msec() > end:
			return "not opened: " + to_json(events)
		yield(self, "idle_frame")
	return true


# ["land", x, y, z, radius]: until it is shown.
func step_land(step: Array):
	yield(self, "idle_frame")
	var before := count_of("shown")
	var landing: int = scene.land(vector(step, 1), step[4])
	var end := OS.get_ticks_msec() + TIMEOUT_MS
	var updates_ms := []
	scene.take_stats()
	while scene.status().get("phase", "") != "shown" or scene.status().landing < landing:
		if OS.get_ticks_msec() > end or scene.status().get("phase", "") == "refused":
			return "not shown: %s %s" % [to_json(scene.status()), to_json(events.slice(max(0, events.size() - 6), events.size() - 1))]
		yield(self, "idle_frame")
		updates_ms.append(scene.take_stats().longest_update_ms)
	var status: Dictionary = scene.status()
	status.erase("position")
	return {"status": status, "visible": Array(scene.visible_segments()), "digest": scene.visible_digest(),
		"swaps": count_of("shown") - before, "updates_ms": updates_ms, "stats": scene.take_stats()}


# ["start", x, y, z, radius]: not waited for.
func step_start(step: Array):
	return scene.land(vector(step, 1), step[4])


# ["aim", x, y, z, radius]: until what it asks for is here.
func step_aim(step: Array):
	var before := count_of("prefetched")
	scene.aim(vector(step, 1), step[4])
	return yield(until_more("prefetched", before), "completed")


# ["pick", x, y, z]: along the vertical.
func step_pick(step: Array):
	var before := count_of("picked")
	scene.pick(vector(step, 1))
	return yield(until_more("picked", before), "completed")


# ["join", group, as guide, own name]: until there is a seat, or none.
func step_join(step: Array):
	yield(self, "idle_frame")
	var before := count_of("group_changed") + count_of("group_refused")
	var end := OS.get_ticks_msec() + TIMEOUT_MS
	if not scene.join_group(step[1], step[2], step[3]):
		return "it cannot join"
	while count_of("group_changed") + count_of("group_refused") <= before:
		if OS.get_ticks_msec() > end:
			return "no seat"
		yield(self, "idle_frame")
	return scene.group()


# ["people", count]: until so many are in the group.
func step_people(step: Array):
	yield(self, "idle_frame")
	var end := OS.get_ticks_msec() + TIMEOUT_MS
	while scene.group() == null or scene.group().members.size() < step[1]:
		if OS.get_ticks_msec() > end:
			return "nobody else: " + to_json(scene.group())
		yield(self, "idle_frame")
	return scene.group()


# ["gather", x, y, z, radius]: until everybody is there, or nobody waits.
func step_gather(step: Array):
	var before := count_of("group_gathered")
	scene.gather(vector(step, 1), step[4])
	return yield(until_more("group_gathered", before), "completed")


# ["there", count]: until so many landings of the group are over, and what is drawn then.
func step_there(step: Array):
	yield(self, "idle_frame")
	var end := OS.get_ticks_msec() + TIMEOUT_MS
	while count_of("group_gathered") < step[1]:
		if OS.get_ticks_msec() > end:
			return "not there: " + to_json(scene.group())
		yield(self, "idle_frame")
	return {"visible": Array(scene.visible_segments()), "group": scene.group()}


# ["cast", [[x, y, z, dx, dy, dz], ...]]
func step_cast(step: Array):
	var hits := []
	for ray in step[1]:
		var hit = scene.cast_ground(vector(ray, 0), vector(ray, 3))
		hits.append(null if hit == null else [hit.position.x, hit.position.y, hit.position.z, hit.segment])
	return hits


# ["collide", [[x, y, z, dx, dy, dz], ...]]: the same by the engine's physics, once its shapes are there.
func step_collide(step: Array):
	for frame in 200:
		yield(self, "physics_frame")
	var hits := []
	for ray in step[1]:
		var from := vector(ray, 0)
		var hit: Dictionary = scene.get_world().direct_space_state.intersect_ray(from, from + 1000.0 * vector(ray, 3).normalized())
		hits.append(null if hit.empty() else [hit.position.x, hit.position.y, hit.position.z])
	return {"hits": hits, "shapes": scene.take_stats().collision_shapes}


# ["places", region]: the named places, a landing at the first one's name, and what a region is part of.
func step_places(step: Array):
	var places := []
	for place in scene.places():
		places.append([place.label, place.region, place.position.x, place.position.y, place.position.z, place.radius_m])
	var landing: int = scene.land_at_place(places[0][0].to_upper()) if not places.empty() else -1
	var pieces := []
	for piece in scene.coarser_pieces(step[1]):
		pieces.append([piece.cost, Array(piece.regions), piece.area_m2, piece.label])
	return {"places": places, "landing": landing, "nowhere": scene.land_at_place("no such place"), "pieces": pieces}


# ["set", name, value]
func step_set(step: Array):
	scene.set(step[1], step[2])
	return true


# ["wait", name]: until there is an event of that name, one more than there were.
func step_wait(step: Array):
	return yield(until_more(step[1], count_of(step[1])), "completed")


# ["pause", milliseconds]
func step_pause(step: Array):
	var end: int = OS.get_ticks_msec() + int(step[1])
	while OS.get_ticks_msec() < end:
		yield(self, "idle_frame")
	return true


# ["look", x, y, z, yaw, pitch, file]: draw from there; yaw 0 looks north, 90 east, degrees.
func step_look(step: Array):
	var image = yield(draw(step), "completed")
	image.save_png(step[6])
	return true


func draw(step: Array):
	camera.transform = Transform(Basis(Vector3(deg2rad(step[5]), deg2rad(-step[4]), 0)), vector(step, 1))
	yield(self, "idle_frame")
	yield(VisualServer, "frame_post_draw")
	var image := root.get_texture().get_data()
	image.flip_y()
	image.convert(Image.FORMAT_RGB8)
	return image


# ["stats"]
func step_stats(_step: Array):
	yield(self, "idle_frame")
	return scene.take_stats()
