# Opens a scene of the example (TERRAPORT_EXAMPLE), lands, teleports, and writes down where the head is; tests/godot says how.
extends SceneTree

var reasons := []


func _init() -> void:
	call_deferred("run")


func run() -> void:
	var world: Spatial = load(OS.get_environment("TERRAPORT_EXAMPLE")).instance()
	var ground: Spatial = world.get_node("Terraport")
	ground.scene_url = OS.get_environment("TERRAPORT_URL")
	ground.radius_m = 12.0
	root.add_child(world)
	var end := OS.get_ticks_msec() + 60000
	while ground.status().get("phase", "") != "shown" and OS.get_ticks_msec() < end:
		yield(self, "idle_frame")
	var first := Array(ground.visible_segments())
	var teleport: Node = world.find_node("Teleport", true, false)
	teleport.connect("stayed", self, "_note")
	var swapped := []
	ground.connect("shown", self, "_note_frame", [swapped, "shown"])
	teleport.connect("teleported", self, "_note_frame", [swapped, "teleported"])
	var at = ground.ground_at(Vector3(42.0, 50.0, 17.0))
	yield(teleport.teleport_to(at.position), "completed")
	var head: Vector3 = teleport.get_node(teleport.camera).global_transform.origin
	if OS.get_environment("TERRAPORT_SHOT") != "":
		yield(VisualServer, "frame_post_draw")
		var image := root.get_texture().get_data()
		image.flip_y()
		image.save_png(OS.get_environment("TERRAPORT_SHOT"))
	var foot = ground.ground_at(head)
	var out := File.new()
	out.open(OS.get_environment("TERRAPORT_OUT"), File.WRITE)
	out.store_string(to_json({"first": first, "second": Array(ground.visible_segments()), "head": [head.x, head.y, head.z],
		"ground_m": foot.position.y, "stayed": reasons, "frames": swapped, "auto_show": ground.auto_show}))
	out.close()
	world.queue_free()
	yield(self, "idle_frame")
	quit()


func _note(reason: String) -> void:
	reasons.append(reason)


func _note_frame(_facts, swapped: Array, name: String) -> void:
	swapped.append([name, Engine.get_frames_drawn()])
