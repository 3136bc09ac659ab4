# Head and hands in a terraport scene: point with a trigger held, let go to be there; the stick turns by 30 degrees.
extends ARVROrigin

# In the order in which they are tried: plugins of the asset library, and what Godot brings along.
const INTERFACES := ["OpenXR", "OpenVR", "OVRMobile", "Oculus"]
const TRIGGER := JOY_VR_TRIGGER
const GRIP := JOY_VR_GRIP
const TURN_DEG := 30.0
# Of the arc: metres a second, seconds of a piece, pieces.
const SPEED := 8.0
const PIECE_S := 0.06
const PIECES := 48

# The TerraportScene.
export(NodePath) var scene

var _pointing: ARVRController = null
var _target = null
var _has_turned := false
var _arc: ImmediateGeometry


func _ready() -> void:
	$Teleport.scene = $Teleport.get_path_to(get_node(scene))
	_arc = ImmediateGeometry.new()
	_arc.set_as_toplevel(true)
	var material := SpatialMaterial.new()
	material.flags_unshaded = true
	material.vertex_color_use_as_albedo = true
	_arc.material_override = material
	add_child(_arc)
	for hand in [$Left, $Right]:
		hand.connect("button_pressed", self, "_on_pressed", [hand])
		hand.connect("button_release", self, "_on_released", [hand])
	if not begin_xr():
		print("terraport: no headset was found; install an XR plugin and switch it on (docs/how-to/godot.md)")


# Whether there is a headset, and it is drawn into.
func begin_xr() -> bool:
	var installed := []
	for facts in ARVRServer.get_interfaces():
		installed.append(facts.name)
	for name in INTERFACES:
		if not name in installed:
			continue
		var interface := ARVRServer.find_interface(name)
		if interface.is_initialized() or interface.initialize():
			get_viewport().arvr = true
			get_viewport().keep_3d_linear = name != "OpenVR"
			Engine.iterations_per_second = 90
			OS.vsync_enabled = false
			return true
	return false


func _process(_delta: float) -> void:
	_arc.clear()
	if _pointing != null:
		_target = _point(_pointing)
		if _target != null:
			$Teleport.aim(_target)
	var turn: float = $Right.get_joystick_axis(0)
	if abs(turn) < 0.4:
		_has_turned = false
	elif abs(turn) > 0.7 and not _has_turned:
		_has_turned = true
		_turn(-sign(turn) * TURN_DEG)


func _on_pressed(button: int, hand: ARVRController) -> void:
	if button == TRIGGER:
		_pointing = hand
	elif button == GRIP:
		_pointing = null


func _on_released(button: int, hand: ARVRController) -> void:
	if button == TRIGGER and _pointing == hand:
		_pointing = null
		if _target != null:
			$Teleport.teleport_to(_target)


# A thrown ball's way, piece by piece, until it meets what is shown. Null where it does not.
func _point(hand: Spatial):
	var at := hand.global_transform.origin
	var velocity := -SPEED * hand.global_transform.basis.z
	_arc.begin(Mesh.PRIMITIVE_LINE_STRIP)
	var met = null
	for _piece in PIECES:
		_arc.set_color(Color(0.1, 0.85, 1.0))
		_arc.add_vertex(at)
		var step := PIECE_S * velocity
		var hit = get_node(scene).cast_ground(at, step, step.length())
		if hit != null:
			_arc.add_vertex(hit.position)
			met = hit.position
			break
		at += step
		velocity += PIECE_S * 9.8 * Vector3.DOWN
	_arc.end()
	return met


# About the head, which stays where it is.
func _turn(degrees: float) -> void:
	var head: Vector3 = $Head.global_transform.origin
	global_transform = Transform(Basis(), head) * Transform(Basis(Vector3.UP, deg2rad(degrees)), Vector3.ZERO) \
			* Transform(Basis(), -head) * global_transform
