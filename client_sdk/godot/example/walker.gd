extends Camera3D
## Mouse and keyboard: hold the right button to look round, W A S D to walk on what is shown, click
## to go there.

const SPEED_M_PER_S := 4.0
const EYE_M := 1.7
const FADE_S := 0.15
## A landing that takes longer is not waited for.
const WAIT_S := 6.0

@export var terrain: TerraportTerrain
## Covers the view; its alpha is the fade's.
@export var veil: ColorRect

## The frame in which [method go_to] last moved the camera.
var moved_frame := 0
var _is_standing := false
var _is_going := false


func _ready() -> void:
	terrain.failed.connect(
			func(code: String, text: String) -> void: push_warning("terraport: %s: %s" % [code, text]))


func _unhandled_input(event: InputEvent) -> void:
	if event is InputEventMouseMotion:
		if event.button_mask & MOUSE_BUTTON_MASK_RIGHT:
			rotation.y -= 0.005 * event.relative.x
			rotation.x = clampf(rotation.x - 0.005 * event.relative.y, -1.5, 1.5)
		else:
			var hit := _under(event.position)
			if not hit.is_empty():
				terrain.prefetch(hit.position)
	elif event is InputEventMouseButton and event.pressed and event.button_index == MOUSE_BUTTON_LEFT:
		var hit := _under(event.position)
		if not hit.is_empty():
			go_to(hit.position)


func _process(delta: float) -> void:
	if not _is_standing: # Onto the ground as soon as there is any.
		_is_standing = _stand_at(position)
	var way := Vector3(
			float(Input.is_key_pressed(KEY_D)) - float(Input.is_key_pressed(KEY_A)), 0.0,
			float(Input.is_key_pressed(KEY_S)) - float(Input.is_key_pressed(KEY_W)))
	if way != Vector3.ZERO and not _is_going:
		var step := Basis(Vector3.UP, rotation.y) * way.normalized()
		_stand_at(position + SPEED_M_PER_S * delta * step)


## Fade out, land, show the landing and move in one frame, fade in.
func go_to(place: Vector3) -> void:
	if _is_going:
		return
	_is_going = true
	terrain.auto_show = false
	terrain.land(place)
	await _fade_to(1.0)
	var end_ms := Time.get_ticks_msec() + int(1000.0 * WAIT_S)
	while not terrain.show_landing() and Time.get_ticks_msec() < end_ms:
		await get_tree().process_frame
	_stand_at(place)
	moved_frame = Engine.get_process_frames()
	terrain.auto_show = true
	await _fade_to(0.0)
	_is_going = false


func _stand_at(place: Vector3) -> bool:
	var hit := terrain.ground_at(place + Vector3.UP)
	if not hit.is_empty():
		position = hit.position + EYE_M * Vector3.UP
	return not hit.is_empty()


func _fade_to(alpha: float) -> void:
	var tween := create_tween()
	tween.tween_property(veil, "color:a", alpha, FADE_S)
	await tween.finished


func _under(place: Vector2) -> Dictionary:
	return terrain.cast_ground(project_ray_origin(place), project_ray_normal(place))
