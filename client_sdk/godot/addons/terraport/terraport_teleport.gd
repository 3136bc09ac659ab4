# Takes somebody elsewhere: darkens, waits until the ground there can be shown, shows it and moves in one frame, and lightens.
class_name TerraportTeleport
extends Node

# Dark; moved (the feet's place); light again.
signal darkened
signal teleported(position)
signal lightened
# There is no ground, or the landing was refused or came too late.
signal stayed(reason)

export(NodePath) var scene
# What is moved: an ARVROrigin, or a camera itself.
export(NodePath) var origin
export(NodePath) var camera
# Of a camera that is moved itself; 0 with an ARVROrigin, whose floor is the ground.
export var eye_height_m := 0.0
export var fade_s := 0.15
export var wait_s := 6.0

var is_underway := false
var _veil: MeshInstance = null
var _black := SpatialMaterial.new()


func _ready() -> void:
	# Before the eyes, in both of them, whatever else is drawn.
	_black.flags_unshaded = true
	_black.flags_transparent = true
	_black.flags_no_depth_test = true
	_black.render_priority = 127
	_black.params_cull_mode = SpatialMaterial.CULL_DISABLED
	_black.albedo_color = Color(0, 0, 0, 0)
	var sphere := SphereMesh.new()
	sphere.radius = 0.5
	sphere.height = 1.0
	sphere.material = _black
	_veil = MeshInstance.new()
	_veil.mesh = sphere
	_veil.visible = false
	_veil.cast_shadow = GeometryInstance.SHADOW_CASTING_SETTING_OFF
	get_node(camera).call_deferred("add_child", _veil)


func _exit_tree() -> void:
	if is_instance_valid(_veil):
		_veil.queue_free()


# Somebody points there, and may let go.
func aim(position: Vector3) -> void:
	get_node(scene).aim(position)


# A coroutine; `yield(teleport.teleport_to(place), "completed")` waits for its end. What is underway goes on.
func teleport_to(position: Vector3) -> void:
	if is_underway:
		return
	is_underway = true
	var ground: Spatial = get_node(scene)
	var shows_itself: bool = ground.auto_show
	ground.auto_show = false
	var landing: int = ground.land(position)
	yield(_fade(1.0), "completed")
	emit_signal("darkened")
	var reason := "it was not ready within %s s" % wait_s
	var end := OS.get_ticks_msec() + int(1000.0 * wait_s)
	while OS.get_ticks_msec() < end:
		var status: Dictionary = ground.status()
		if status.get("phase", "none") == "refused":
			reason = status.refusal
			break
		if status.get("landing", -1) >= landing and status.phase.begins_with("presentable"):
			reason = ""
			break
		yield(get_tree(), "idle_frame")
	if reason == "":
		# Both in this frame.
		ground.show_landing()
		reason = _move(ground, position)
	ground.auto_show = shows_itself
	yield(_fade(0.0), "completed")
	emit_signal("lightened")
	is_underway = false
	if reason != "":
		emit_signal("stayed", reason)


# The head comes to be above the place, the floor on the ground.
func _move(ground: Spatial, position: Vector3) -> String:
	var hit = ground.ground_at(position + Vector3.UP)
	if hit == null:
		return "there is no ground"
	var moved: Spatial = get_node(origin)
	var head: Vector3 = get_node(camera).global_transform.origin - moved.global_transform.origin
	moved.global_transform.origin = hit.position - Vector3(head.x, 0.0, head.z) + eye_height_m * Vector3.UP
	emit_signal("teleported", hit.position)
	return ""


func _fade(target: float) -> void:
	var from := _black.albedo_color.a
	var passed := 0.0
	_veil.visible = true
	while passed < fade_s:
		yield(get_tree(), "idle_frame")
		passed += get_process_delta_time()
		_black.albedo_color.a = lerp(from, target, min(passed / max(fade_s, 0.001), 1.0))
	_black.albedo_color.a = target
	_veil.visible = target > 0.0
	# At least one frame of it is drawn.
	yield(get_tree(), "idle_frame")
