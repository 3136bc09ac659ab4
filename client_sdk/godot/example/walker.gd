# Mouse and keyboard: hold the right button to look round, W A S D to walk on what is shown, click to go there.
extends Camera

const SPEED := 4.0
const EYE_M := 1.7

export(NodePath) var scene

onready var ground: Spatial = get_node(scene)
onready var teleport: Node = $Teleport

var _is_standing := false


func _ready() -> void:
	teleport.scene = teleport.get_path_to(ground)
	ground.connect("failed", self, "_on_failed")


func _unhandled_input(event: InputEvent) -> void:
	if event is InputEventMouseMotion and Input.is_mouse_button_pressed(BUTTON_RIGHT):
		rotation.y -= 0.005 * event.relative.x
		rotation.x = clamp(rotation.x - 0.005 * event.relative.y, -1.5, 1.5)
	elif event is InputEventMouseMotion:
		var hit = _under(event.position)
		if hit != null:
			teleport.aim(hit.position)
	elif event is InputEventMouseButton and event.pressed and event.button_index == BUTTON_LEFT:
		var hit = _under(event.position)
		if hit != null:
			teleport.teleport_to(hit.position)


func _process(delta: float) -> void:
	# Onto the ground as soon as there is any.
	if not _is_standing:
		_is_standing = _stand()
	var way := Vector3.ZERO
	way.x = float(Input.is_key_pressed(KEY_D)) - float(Input.is_key_pressed(KEY_A))
	way.z = float(Input.is_key_pressed(KEY_S)) - float(Input.is_key_pressed(KEY_W))
	if way != Vector3.ZERO and not teleport.is_underway:
		translation += SPEED * delta * Basis(Vector3.UP, rotation.y).xform(way.normalized())
		_stand()


func _stand() -> bool:
	var hit = ground.ground_at(translation)
	if hit != null:
		translation.y = hit.position.y + EYE_M
	return hit != null


func _under(place: Vector2):
	return ground.cast_ground(project_ray_origin(place), project_ray_normal(place))


func _on_failed(facts: Dictionary) -> void:
	print("terraport: %s: %s" % [facts.code, facts.message])
