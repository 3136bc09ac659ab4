class_name TerraportSegment
extends RefCounted
## One mesh in segment format 2 (spec/segment-format.md): a segment, or the base of a scene.
##
## [method decode] touches nothing but its own object: it may run on any thread.

## Value in [member facts] where there is none: shaders have no reliable NAN.
const NO_VALUE := -1e30

const _MAX_STREAM_BYTES := 1 << 28
const _MAX_STEPS := 1 << 24
const _MAX_STEP_EXPONENT := 103 # 2^24 such steps are finite in float32
const _HEAD_BYTES := 40
const _COLOURS := 1
const _UVS := 2
const _REGIONS := 4
const _WIDE := 8
const _NO_REGION := 65535
const _NO_CODE := 65535
const _KTX2 := 4
const _TILE := 65535

## Why the bytes are not a valid segment; empty if they are.
var error := ""
var positions := PackedVector3Array()
## Three corners per face, clockwise as seen from the front, as in all of Godot.
var faces := PackedInt32Array()
var normals := PackedVector3Array()
## Empty without colours.
var colours := PackedColorArray()
## Empty without a texture.
var uvs := PackedVector2Array()
## Region of all vertices, or -1.
var region := -1
## Region and attribute value of each vertex; empty if all have [member region] and none a value.
var facts := PackedVector2Array()
## The texture with its mipmaps, or null.
var image: Image
## Least x, y, z, then greatest; metres, scene frame.
var bounds := PackedFloat64Array([0, 0, 0, 0, 0, 0])
## Memory that it takes, decoded and uploaded.
var bytes := 0
## The node that draws it; set and freed by [TerraportTerrain].
var instance: MeshInstance3D

var _max_side := 2048
var _stream := PackedByteArray()
var _at := 0
var _triangles: TriangleMesh


## Decode a payload. [param attributes] are those of the scene's manifest, [param wanted] is the
## name of the one whose values are read, [param max_side] bounds the image. Check [member error].
static func decode(
		payload: PackedByteArray, attributes: Array = [], wanted := "", max_side := 2048
) -> TerraportSegment:
	var segment := TerraportSegment.new()
	segment._max_side = max_side
	segment._decode(payload, attributes, wanted)
	segment._stream = PackedByteArray()
	return segment


## Arrays for [method ArrayMesh.add_surface_from_arrays]. UV2 holds region and attribute.
func mesh_arrays() -> Array:
	var arrays: Array = []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = positions
	arrays[Mesh.ARRAY_NORMAL] = normals
	arrays[Mesh.ARRAY_INDEX] = faces
	if not colours.is_empty():
		arrays[Mesh.ARRAY_COLOR] = colours
	if not uvs.is_empty():
		arrays[Mesh.ARRAY_TEX_UV] = uvs
	if not facts.is_empty():
		arrays[Mesh.ARRAY_TEX_UV2] = facts
	return arrays


## Duplicate shared vertices: vertex 3 f + k is corner k of face f.
func separate_faces() -> void:
	var tool := SurfaceTool.new()
	tool.create_from_arrays(mesh_arrays())
	tool.deindex()
	var arrays := tool.commit_to_arrays()
	positions = arrays[Mesh.ARRAY_VERTEX]
	normals = arrays[Mesh.ARRAY_NORMAL]
	faces = PackedInt32Array(range(positions.size()))
	if not colours.is_empty():
		colours = arrays[Mesh.ARRAY_COLOR]
	if not uvs.is_empty():
		uvs = arrays[Mesh.ARRAY_TEX_UV]
	if not facts.is_empty():
		facts = arrays[Mesh.ARRAY_TEX_UV2]


## Return the positions of the three corners of each face.
func corners() -> PackedVector3Array:
	var places := PackedVector3Array()
	places.resize(faces.size())
	for corner: int in faces.size():
		places[corner] = positions[faces[corner]]
	return places


## Return the first hit of a ray: position, normal, face_index; empty without a hit.
func intersect_ray(origin: Vector3, direction: Vector3) -> Dictionary:
	var least := Vector3(bounds[0], bounds[1], bounds[2])
	var box := AABB(least, Vector3(bounds[3], bounds[4], bounds[5]) - least).grow(0.01)
	if box.intersects_ray(origin, direction) == null:
		return {}
	if _triangles == null:
		_triangles = TriangleMesh.new()
		_triangles.create_from_faces(corners())
	return _triangles.intersect_ray(origin, direction)


func _decode(payload: PackedByteArray, attributes: Array, wanted: String) -> void:
	if not _inflate(payload):
		return
	var vertex_count := _stream.decode_u32(0)
	var face_count := _stream.decode_u32(4)
	var flags := _stream[21]
	var kind := _stream[22]
	var width := _stream.decode_u16(26)
	var height := _stream.decode_u16(28)
	var mask := _stream.decode_u32(32)
	region = _stream.decode_u16(24)
	region = -1 if region == _NO_REGION else region
	var image_bytes := payload.slice(12 + payload.decode_u32(4))
	if vertex_count == 0 or face_count == 0 or flags > 15 or kind > _KTX2:
		_fail("%d vertices, %d faces, flags %d, image %d" % [vertex_count, face_count, flags, kind],
				"at least one face, flags below 16, an image up to 4")
	elif (kind > 0) != (flags & _UVS > 0) or (kind > 0) == image_bytes.is_empty():
		_fail("an image or texture coordinates alone", "both or none")
	elif mask >> attributes.size() > 0:
		_fail("attributes 0x%x" % mask, "some of the scene's %d" % attributes.size())
	if error != "":
		return
	_read_faces(vertex_count, face_count)
	_read_positions(vertex_count, 4 if flags & _WIDE else 2)
	_read_normals(vertex_count)
	if flags & _COLOURS:
		_read_colours(vertex_count)
	if flags & _UVS:
		_read_uvs(vertex_count, width, height)
	var regions := _differences(vertex_count, 2) if flags & _REGIONS else PackedInt32Array()
	var codes := PackedInt32Array()
	var scale := {"offset": 0.0, "step": 0.0}
	for bit: int in attributes.size():
		if mask >> bit & 1 and attributes[bit].name == wanted:
			scale = attributes[bit]
			codes = _differences(vertex_count, 2)
		elif mask >> bit & 1:
			_take(2 * vertex_count)
	if error == "" and _at != _stream.size():
		_fail("%d bytes behind the last plane" % (_stream.size() - _at), "none")
	if error == "" and kind > 0:
		_read_image(image_bytes, kind, Vector2i(width, height))
	if error == "" and not (regions.is_empty() and codes.is_empty()):
		_join_facts(vertex_count, regions, codes, scale)
	bytes = 40 * vertex_count + 18 * face_count
	if image != null:
		bytes += image.get_data_size()


func _fail(got: String, expected: String) -> void:
	if error == "":
		error = "got %s, expected %s" % [got, expected]


# The gzip trailer has the inflated size and a CRC-32; zlib checks both.
func _inflate(payload: PackedByteArray) -> bool:
	var size := payload.size()
	if size < 12 + 18 or payload.slice(0, 4).get_string_from_ascii() != "TSG2":
		_fail("%d bytes that begin with another magic" % size, "TSG2")
		return false
	var packed := payload.decode_u32(4)
	if 12 + packed + payload.decode_u32(8) != size or packed < 18:
		_fail("%d bytes" % size, "what the first 12 bytes say")
		return false
	var whole := payload.decode_u32(12 + packed - 4)
	if whole < _HEAD_BYTES or whole > _MAX_STREAM_BYTES:
		_fail("a stream of %d bytes" % whole, "%d to %d" % [_HEAD_BYTES, _MAX_STREAM_BYTES])
		return false
	_stream = payload.slice(12, 12 + packed).decompress(whole, FileAccess.COMPRESSION_GZIP)
	if _stream.size() != whole:
		_fail("a damaged stream", "%d bytes with their checksum" % whole)
	_at = _HEAD_BYTES
	return error == ""


# Return the offset of the next bytes; -1 if the stream is too short.
func _take(count: int) -> int:
	var begin := _at
	if error != "" or begin + count > _stream.size():
		_fail("a plane of %d bytes" % count, "at most %d" % (_stream.size() - begin))
		return -1
	_at += count
	return begin


# Read a plane of differences; empty if the stream is too short.
func _differences(count: int, width: int) -> PackedInt32Array:
	var sums := PackedInt32Array()
	var low := _take(count * width)
	if low < 0:
		return sums
	sums.resize(count)
	var stream := _stream
	var high := low + count
	var sum := 0
	var zigzag := 0
	if width == 1:
		for place: int in count:
			zigzag = stream[low + place]
			sum = (sum + ((zigzag >> 1) ^ -(zigzag & 1))) & 0xFF
			sums[place] = sum
	elif width == 2:
		for place: int in count:
			zigzag = stream[low + place] | stream[high + place] << 8
			sum = (sum + ((zigzag >> 1) ^ -(zigzag & 1))) & 0xFFFF
			sums[place] = sum
	else:
		for place: int in count:
			zigzag = stream[low + place] | stream[high + place] << 8 \
					| stream[high + count + place] << 16 | stream[high + 2 * count + place] << 24
			sum = (sum + ((zigzag >> 1) ^ -(zigzag & 1))) & 0xFFFFFFFF
			sums[place] = sum
	return sums


func _read_faces(vertex_count: int, face_count: int) -> void:
	var starts := _take((face_count + 7) >> 3)
	var lefts := _take((face_count + 7) >> 3)
	if lefts < 0:
		return
	var stream := _stream
	var start_count := 0
	for face: int in face_count:
		start_count += stream[starts + (face >> 3)] >> (face & 7) & 1
	var named_count := face_count + 2 * start_count
	var news := _take((named_count + 7) >> 3)
	if named_count < vertex_count or stream[starts] & 1 == 0:
		_fail("%d corners for %d vertices" % [named_count, vertex_count], "a strip with as many")
	var olds := _differences(named_count - vertex_count, 2 if vertex_count <= 65536 else 4)
	if error != "":
		return
	faces.resize(3 * face_count)
	var old_at := 0
	var old_count := olds.size()
	var fresh := 0
	var at := 0
	var first := 0
	var second := 0
	var third := 0
	for face: int in face_count:
		var named := 1
		if stream[starts + (face >> 3)] >> (face & 7) & 1:
			named = 3
		elif stream[lefts + (face >> 3)] >> (face & 7) & 1:
			second = third
		else:
			first = third
		while named > 0:
			if stream[news + (at >> 3)] >> (at & 7) & 1:
				third = fresh
				fresh += 1
			else:
				if old_at == old_count or olds[old_at] < 0 or olds[old_at] >= fresh:
					_fail("a corner that is not there yet", "one of %d" % fresh)
					return
				third = olds[old_at]
				old_at += 1
			at += 1
			named -= 1
			if named == 2:
				first = third
			elif named == 1:
				second = third
		faces[3 * face] = first
		faces[3 * face + 1] = third
		faces[3 * face + 2] = second
	if fresh != vertex_count:
		_fail("%d vertices in faces" % fresh, str(vertex_count))


func _read_positions(count: int, width: int) -> void:
	var axes: Array[PackedInt32Array] = []
	var exponent := _stream.decode_s8(20)
	if exponent > _MAX_STEP_EXPONENT:
		_fail("steps of 2^%d m" % exponent, "at most 2^%d" % _MAX_STEP_EXPONENT)
		return
	var step := 2.0 ** exponent
	for axis: int in 3:
		var codes := _differences(count, width)
		if error != "":
			return
		var origin := _stream.decode_s32(8 + 4 * axis)
		var range_of := Array(codes)
		var least: int = origin + range_of.min()
		var greatest: int = origin + range_of.max()
		if least <= -_MAX_STEPS or greatest >= _MAX_STEPS or range_of.min() < 0:
			_fail("a position 2^24 steps or more from the origin", "less")
			return
		bounds[axis] = least * step
		bounds[axis + 3] = greatest * step
		axes.append(codes)
	positions.resize(count)
	var xs := axes[0]
	var ys := axes[1]
	var zs := axes[2]
	var x := _stream.decode_s32(8)
	var y := _stream.decode_s32(12)
	var z := _stream.decode_s32(16)
	for vertex: int in count:
		positions[vertex] = Vector3(
				(x + xs[vertex]) * step, (y + ys[vertex]) * step, (z + zs[vertex]) * step)


func _read_normals(count: int) -> void:
	var xs := _differences(count, 1)
	var zs := _differences(count, 1)
	if error != "":
		return
	normals.resize(count)
	for vertex: int in count:
		var x := xs[vertex] / 127.0 if xs[vertex] < 128 else (xs[vertex] - 256) / 127.0
		var z := zs[vertex] / 127.0 if zs[vertex] < 128 else (zs[vertex] - 256) / 127.0
		var y := 1.0 - absf(x) - absf(z)
		if y < 0.0:
			x = signf(x) * maxf(absf(x) + y, 0.0)
			z = signf(z) * maxf(absf(z) + y, 0.0)
		normals[vertex] = Vector3(x, y, z).normalized()


func _read_colours(count: int) -> void:
	var greens := _differences(count, 1)
	var reds := _differences(count, 1)
	var blues := _differences(count, 1)
	if error != "":
		return
	colours.resize(count)
	for vertex: int in count:
		var green := greens[vertex]
		colours[vertex] = Color((reds[vertex] + green & 0xFF) / 255.0, green / 255.0,
				(blues[vertex] + green & 0xFF) / 255.0)


func _read_uvs(count: int, width: int, height: int) -> void:
	var us := _differences(count, 2)
	var vs := _differences(count, 2)
	if error != "" or width == 0 or height == 0:
		_fail("an image of %d x %d" % [width, height], "sides above 0")
		return
	uvs.resize(count)
	for vertex: int in count:
		uvs[vertex] = Vector2(us[vertex] / (2.0 * width), vs[vertex] / (2.0 * height))


func _join_facts(
		count: int, regions: PackedInt32Array, codes: PackedInt32Array, scale: Dictionary
) -> void:
	var offset: float = scale.offset
	var step: float = scale.step
	facts.resize(count)
	for vertex: int in count:
		var code := _NO_CODE if codes.is_empty() else codes[vertex]
		facts[vertex] = Vector2(
				region if regions.is_empty() else regions[vertex],
				NO_VALUE if code == _NO_CODE else offset + step * code)


func _read_image(data: PackedByteArray, kind: int, sides: Vector2i) -> void:
	if _image_sides(data, kind) != sides or nearest_po2(sides.x) != sides.x \
			or nearest_po2(sides.y) != sides.y or maxi(sides.x, sides.y) > _max_side:
		_fail("an image of another type or size", "%d x %d, powers of two to %d"
				% [sides.x, sides.y, _max_side])
	elif not _has_checksum(data, _stream.decode_u32(36)):
		_fail("a damaged image", "its checksum")
	if error != "":
		return
	var read := Image.new()
	var failure := ERR_UNAVAILABLE
	match kind:
		1:
			failure = read.load_jpg_from_buffer(data)
		2:
			failure = read.load_png_from_buffer(data)
		3:
			failure = read.load_webp_from_buffer(data)
		_KTX2:
			failure = read.load_ktx_from_buffer(data)
	if failure != OK:
		_fail("an image that cannot be read (%s)" % error_string(failure), "JPEG, PNG, WebP, KTX2")
		return
	if not read.is_compressed():
		read.generate_mipmaps()
	image = read


# Check a CRC-32 by the engine's zlib, in native code: as a gzip stream of stored blocks.
static func _has_checksum(data: PackedByteArray, checksum: int) -> bool:
	var wrapped := StreamPeerBuffer.new()
	wrapped.put_data(PackedByteArray([0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 0, 255]))
	for begin: int in range(0, data.size(), _TILE):
		var part := data.slice(begin, begin + _TILE)
		wrapped.put_u8(1 if begin + _TILE >= data.size() else 0)
		wrapped.put_u16(part.size())
		wrapped.put_u16(part.size() ^ 0xFFFF)
		wrapped.put_data(part)
	wrapped.put_u32(checksum)
	wrapped.put_u32(data.size())
	return wrapped.data_array.decompress(data.size(), FileAccess.COMPRESSION_GZIP) == data


# Read width and height from the image's header; zeros if it is of another type.
static func _image_sides(data: PackedByteArray, kind: int) -> Vector2i:
	if data.size() < 32:
		return Vector2i.ZERO
	var reader := StreamPeerBuffer.new()
	reader.data_array = data
	reader.big_endian = kind <= 2
	if kind == 1 and data.decode_u16(0) == 0xD8FF:
		reader.seek(2)
		while reader.get_available_bytes() > 9 and reader.get_u8() == 0xFF:
			var marker := reader.get_u8()
			var next := reader.get_position() + reader.get_u16()
			if marker >= 0xC0 and marker <= 0xCF and marker not in [0xC4, 0xC8, 0xCC]:
				reader.get_u8()
				var height := reader.get_u16()
				return Vector2i(reader.get_u16(), height)
			if next >= data.size():
				break
			reader.seek(next)
	elif kind == 2 and data.slice(1, 4).get_string_from_ascii() == "PNG":
		reader.seek(16)
		return Vector2i(reader.get_32(), reader.get_32())
	elif kind == 3 and data.slice(8, 12).get_string_from_ascii() == "WEBP":
		match data.slice(12, 16).get_string_from_ascii():
			"VP8 ":
				return Vector2i(data.decode_u16(26) & 0x3FFF, data.decode_u16(28) & 0x3FFF)
			"VP8L":
				var bits := data.decode_u32(21)
				return Vector2i(1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF))
			"VP8X":
				return Vector2i(
						1 + (data.decode_u32(24) & 0xFFFFFF), 1 + (data.decode_u32(26) >> 8))
	elif kind == _KTX2 and data.slice(1, 7).get_string_from_ascii() == "KTX 20":
		return Vector2i(data.decode_u32(20), data.decode_u32(24))
	return Vector2i.ZERO
