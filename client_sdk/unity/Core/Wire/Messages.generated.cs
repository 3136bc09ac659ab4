// Written by `python -m terraport_wire.schema` from the message classes in Python; do not edit.

using System.Collections.Generic;

namespace Terraport.Wire
{
    /// <summary>
    /// Bounds that every speaker keeps (section 12); a server may be stricter.
    /// </summary>
    public static class WireLimits
    {
        /// <summary>Major version of the protocol that this client speaks.</summary>
        public const int ProtocolMajor = 1;

        /// <summary>Newest minor version that this client speaks.</summary>
        public const int ProtocolMinor = 0;

        /// <summary>The WebSocket subprotocol; it pins the major version.</summary>
        public const string Subprotocol = "terraport.v1.msgpack";

        /// <summary>Block bytes.</summary>
        public const int BlockBytes = 64;

        /// <summary>Header bytes.</summary>
        public const int HeaderBytes = 24;

        /// <summary>Max attributes.</summary>
        public const int MaxAttributes = 64;

        /// <summary>Max chunk bytes.</summary>
        public const int MaxChunkBytes = 131048;

        /// <summary>Max client message bytes.</summary>
        public const int MaxClientMessageBytes = 1048576;

        /// <summary>Max client values.</summary>
        public const int MaxClientValues = 1024;

        /// <summary>Max container items.</summary>
        public const int MaxContainerItems = 16384;

        /// <summary>Max coordinate m.</summary>
        public const double MaxCoordinateM = 10000000.0;

        /// <summary>Max deadline ms.</summary>
        public const int MaxDeadlineMs = 600000;

        /// <summary>Max depth.</summary>
        public const int MaxDepth = 16;

        /// <summary>Max frame bytes.</summary>
        public const int MaxFrameBytes = 131072;

        /// <summary>Max gpu element bytes.</summary>
        public const int MaxGpuElementBytes = 4096;

        /// <summary>Max group members.</summary>
        public const int MaxGroupMembers = 1024;

        /// <summary>Max group name.</summary>
        public const int MaxGroupName = 64;

        /// <summary>Max header bytes.</summary>
        public const int MaxHeaderBytes = 1024;

        /// <summary>Max held segments.</summary>
        public const int MaxHeldSegments = 32768;

        /// <summary>Max integer.</summary>
        public const long MaxInteger = 9007199254740991;

        /// <summary>Max levels.</summary>
        public const int MaxLevels = 2;

        /// <summary>Max plan segments.</summary>
        public const int MaxPlanSegments = 16384;

        /// <summary>Max radius m.</summary>
        public const double MaxRadiusM = 1000000.0;

        /// <summary>Max release factor.</summary>
        public const double MaxReleaseFactor = 4.0;

        /// <summary>Max segment bytes.</summary>
        public const int MaxSegmentBytes = 67108864;

        /// <summary>Max server message bytes.</summary>
        public const int MaxServerMessageBytes = 8388608;

        /// <summary>Max token bytes.</summary>
        public const int MaxTokenBytes = 4096;
    }

    /// <summary>The close code of each error where it is fatal (section 11).</summary>
    public static class CloseCodes
    {
        /// <summary>Of <c>malformed</c>.</summary>
        public const int Malformed = 4400;

        /// <summary>Of <c>invalid_field</c>.</summary>
        public const int InvalidField = 4400;

        /// <summary>Of <c>out_of_order</c>.</summary>
        public const int OutOfOrder = 4400;

        /// <summary>Of <c>radius_too_large</c>.</summary>
        public const int RadiusTooLarge = 4400;

        /// <summary>Of <c>unauthorised</c>.</summary>
        public const int Unauthorised = 4401;

        /// <summary>Of <c>forbidden</c>.</summary>
        public const int Forbidden = 4403;

        /// <summary>Of <c>unknown_scene</c>.</summary>
        public const int UnknownScene = 4404;

        /// <summary>Of <c>timeout</c>.</summary>
        public const int Timeout = 4408;

        /// <summary>Of <c>unsupported_version</c>.</summary>
        public const int UnsupportedVersion = 4409;

        /// <summary>Of <c>unsupported_encoding</c>.</summary>
        public const int UnsupportedEncoding = 4409;

        /// <summary>Of <c>too_large</c>.</summary>
        public const int TooLarge = 4413;

        /// <summary>Of <c>too_many</c>.</summary>
        public const int TooMany = 4429;

        /// <summary>Of <c>internal</c>.</summary>
        public const int Internal = 4500;

        /// <summary>Of <c>draining</c>.</summary>
        public const int Draining = 4503;

        /// <summary>Of <c>group_refused</c>.</summary>
        public const int GroupRefused = 4403;

        internal static readonly KeyValuePair<string, int>[] ByError =
        {
            new KeyValuePair<string, int>("malformed", 4400),
            new KeyValuePair<string, int>("invalid_field", 4400),
            new KeyValuePair<string, int>("out_of_order", 4400),
            new KeyValuePair<string, int>("radius_too_large", 4400),
            new KeyValuePair<string, int>("unauthorised", 4401),
            new KeyValuePair<string, int>("forbidden", 4403),
            new KeyValuePair<string, int>("unknown_scene", 4404),
            new KeyValuePair<string, int>("timeout", 4408),
            new KeyValuePair<string, int>("unsupported_version", 4409),
            new KeyValuePair<string, int>("unsupported_encoding", 4409),
            new KeyValuePair<string, int>("too_large", 4413),
            new KeyValuePair<string, int>("too_many", 4429),
            new KeyValuePair<string, int>("internal", 4500),
            new KeyValuePair<string, int>("draining", 4503),
            new KeyValuePair<string, int>("group_refused", 4403),
        };

        internal static readonly KeyValuePair<int, int>[] ByHttpStatus =
        {
            new KeyValuePair<int, int>(200, 1000),
            new KeyValuePair<int, int>(400, 4400),
            new KeyValuePair<int, int>(401, 4401),
            new KeyValuePair<int, int>(403, 4403),
            new KeyValuePair<int, int>(404, 4404),
            new KeyValuePair<int, int>(408, 4408),
            new KeyValuePair<int, int>(409, 4409),
            new KeyValuePair<int, int>(413, 4413),
            new KeyValuePair<int, int>(429, 4429),
            new KeyValuePair<int, int>(500, 4500),
            new KeyValuePair<int, int>(503, 4503),
        };
    }

    /// <summary>What one landing may hold in all (load and keep together); absent means unlimited.</summary>
    public sealed class BudgetsPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("max_triangles", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("max_bytes", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("max_segments", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("max_gpu_bytes", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("gpu_vertex_bytes", false, new IntegerKind(1L, 4096L)),
            new Field("gpu_face_bytes", false, new IntegerKind(1L, 4096L)),
        };

        /// <summary>Most triangles. Null where absent.</summary>
        public long? MaxTriangles { get; set; }

        /// <summary>Most payload bytes. Null where absent.</summary>
        public long? MaxBytes { get; set; }

        /// <summary>Most segments. Null where absent.</summary>
        public long? MaxSegments { get; set; }

        /// <summary>Most bytes on the client's GPU (section 6.2). Null where absent.</summary>
        public long? MaxGpuBytes { get; set; }

        /// <summary>Bytes of a vertex in the client's buffers; absent means 24. Null where absent.</summary>
        public int? GpuVertexBytes { get; set; }

        /// <summary>Bytes of a triangle's three indices in them; absent means 6. Null where absent.</summary>
        public int? GpuFaceBytes { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return MaxTriangles.HasValue ? (object)(long)MaxTriangles.Value : null;
                case 1: return MaxBytes.HasValue ? (object)(long)MaxBytes.Value : null;
                case 2: return MaxSegments.HasValue ? (object)(long)MaxSegments.Value : null;
                case 3: return MaxGpuBytes.HasValue ? (object)(long)MaxGpuBytes.Value : null;
                case 4: return GpuVertexBytes.HasValue ? (object)(long)GpuVertexBytes.Value : null;
                case 5: return GpuFaceBytes.HasValue ? (object)(long)GpuFaceBytes.Value : null;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: MaxTriangles = value == null ? (long?)null : (long)(long)value; return;
                case 1: MaxBytes = value == null ? (long?)null : (long)(long)value; return;
                case 2: MaxSegments = value == null ? (long?)null : (long)(long)value; return;
                case 3: MaxGpuBytes = value == null ? (long?)null : (long)(long)value; return;
                case 4: GpuVertexBytes = value == null ? (int?)null : (int)(long)value; return;
                case 5: GpuFaceBytes = value == null ? (int?)null : (int)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Which scene is served.</summary>
    public sealed class SceneInfoPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("id", true, new TextKind(1, 128, null)),
            new Field("version", true, new TextKind(1, 64, null)),
            new Field("name", true, new TextKind(0, 256, null)),
            new Field("segment_count", true, new IntegerKind(0L, 4294967295L)),
            new Field("levels", false, new IntegerKind(1L, 2L)),
        };

        /// <summary>Id of the scene in URLs.</summary>
        public string Id { get; set; }

        /// <summary>Version; changes whenever any byte does.</summary>
        public string Version { get; set; }

        /// <summary>Name for people.</summary>
        public string Name { get; set; }

        /// <summary>Segments of the scene: ids are below it, those of coarser levels above (section 6.1).</summary>
        public uint SegmentCount { get; set; }

        /// <summary>Levels of every segment; absent means 1. Null where absent.</summary>
        public int? Levels { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Id;
                case 1: return Version;
                case 2: return Name;
                case 3: return (long)SegmentCount;
                case 4: return Levels.HasValue ? (object)(long)Levels.Value : null;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Id = (string)value; return;
                case 1: Version = (string)value; return;
                case 2: Name = (string)value; return;
                case 3: SegmentCount = (uint)(long)value; return;
                case 4: Levels = value == null ? (int?)null : (int)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>What this server allows on this connection.</summary>
    public sealed class ServerLimitsPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("max_radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("max_message_bytes", true, new IntegerKind(1L, 9007199254740991L)),
            new Field("max_messages_per_s", true, new NumberKind(0.0, 1000000000.0, true)),
            new Field("max_held_segments", true, new IntegerKind(0L, 32768L)),
            new Field("max_plan_segments", true, new IntegerKind(0L, 16384L)),
            new Field("max_credit_bytes", true, new IntegerKind(1L, 9007199254740991L)),
            new Field("idle_timeout_s", true, new NumberKind(0.0, 1000000000.0, true)),
            new Field("groups", false, new ChoiceKind("none", "here", "query")),
        };

        /// <summary>Largest radius of aim and land.</summary>
        public double MaxRadiusM { get; set; }

        /// <summary>Largest message to the server.</summary>
        public long MaxMessageBytes { get; set; }

        /// <summary>Messages per second, averaged over 10 s.</summary>
        public double MaxMessagesPerS { get; set; }

        /// <summary>Most segments in hello.held.</summary>
        public int MaxHeldSegments { get; set; }

        /// <summary>Most segments in a plan, as a budget would cut.</summary>
        public int MaxPlanSegments { get; set; }

        /// <summary>Most outstanding credit; more is clamped.</summary>
        public long MaxCreditBytes { get; set; }

        /// <summary>Silence after which the server closes.</summary>
        public double IdleTimeoutS { get; set; }

        /// <summary>Whether groups can be joined: <c>here</c>; <c>query</c>: only where the URL of the stream names the group; <c>none</c>. Absent means <c>none</c>. Null where absent.</summary>
        public string Groups { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return MaxRadiusM;
                case 1: return (long)MaxMessageBytes;
                case 2: return MaxMessagesPerS;
                case 3: return (long)MaxHeldSegments;
                case 4: return (long)MaxPlanSegments;
                case 5: return (long)MaxCreditBytes;
                case 6: return IdleTimeoutS;
                case 7: return Groups;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: MaxRadiusM = (double)value; return;
                case 1: MaxMessageBytes = (long)(long)value; return;
                case 2: MaxMessagesPerS = (double)value; return;
                case 3: MaxHeldSegments = (int)(long)value; return;
                case 4: MaxPlanSegments = (int)(long)value; return;
                case 5: MaxCreditBytes = (long)(long)value; return;
                case 6: IdleTimeoutS = (double)value; return;
                case 7: Groups = (string)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Where a client that pulls fetches payload.</summary>
    public sealed class PullInfoPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("base", true, new TextKind(0, 2048, null)),
            new Field("pack", true, new TextKind(1, 201, null)),
            new Field("pack_bytes", true, new IntegerKind(1L, 9007199254740991L)),
        };

        /// <summary>Base address, ending in <c>/</c>: <c>http</c> or <c>https</c>, or relative to the server URL.</summary>
        public string Base { get; set; }

        /// <summary>Path of the pack below the base address; its bytes never change.</summary>
        public string Pack { get; set; }

        /// <summary>Length of the pack.</summary>
        public long PackBytes { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Base;
                case 1: return Pack;
                case 2: return (long)PackBytes;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Base = (string)value; return;
                case 1: Pack = (string)value; return;
                case 2: PackBytes = (long)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>When the server did what for one landing, in microseconds since it received land.</summary>
    public sealed class TimingsPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("plan_us", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("first_byte_us", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("last_byte_us", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("ready_us", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("credit_wait_us", true, new IntegerKind(0L, 9007199254740991L)),
        };

        /// <summary>Plan handed to the socket; absent where the plan was still waiting for that. Null where absent.</summary>
        public long? PlanUs { get; set; }

        /// <summary>First chunk on its way; absent where there was none. Null where absent.</summary>
        public long? FirstByteUs { get; set; }

        /// <summary>Last chunk on its way; absent where there was none. Null where absent.</summary>
        public long? LastByteUs { get; set; }

        /// <summary>Ready decided.</summary>
        public long ReadyUs { get; set; }

        /// <summary>How long there was payload to send and no credit: time that the client took.</summary>
        public long CreditWaitUs { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return PlanUs.HasValue ? (object)(long)PlanUs.Value : null;
                case 1: return FirstByteUs.HasValue ? (object)(long)FirstByteUs.Value : null;
                case 2: return LastByteUs.HasValue ? (object)(long)LastByteUs.Value : null;
                case 3: return (long)ReadyUs;
                case 4: return (long)CreditWaitUs;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: PlanUs = value == null ? (long?)null : (long)(long)value; return;
                case 1: FirstByteUs = value == null ? (long?)null : (long)(long)value; return;
                case 2: LastByteUs = value == null ? (long?)null : (long)(long)value; return;
                case 3: ReadyUs = (long)(long)value; return;
                case 4: CreditWaitUs = (long)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>What a pick met.</summary>
    public sealed class HitPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("normal", true, new PositionKind(1.5, false)),
            new Field("segment", true, new IntegerKind(0L, 4294967295L)),
            new Field("region", true, new IntegerKind(0L, 4294967295L)),
            new Field("stable_id", false, new IntegerKind(0L, 4294967295L)),
            new Field("label", false, new TextKind(0, 256, null)),
            new Field("height_m", true, new NumberKind(-1000000000.0, 1000000000.0, false)),
            new Field("attributes", true, new NumbersKind(64)),
        };

        /// <summary>Point of the surface, metres of the scene frame.</summary>
        public Vec3 Position { get; set; }

        /// <summary>Unit normal of the face.</summary>
        public Vec3 Normal { get; set; }

        /// <summary>Segment of the face.</summary>
        public uint Segment { get; set; }

        /// <summary>Region of the face, in this scene version.</summary>
        public uint Region { get; set; }

        /// <summary>Number of the region that is the same in every version of the scene, where it has one. Null where absent.</summary>
        public uint? StableId { get; set; }

        /// <summary>Label of the region when the pick is answered, where it has one. Null where absent.</summary>
        public string Label { get; set; }

        /// <summary>Height in metres in the survey's own vertical reference.</summary>
        public double HeightM { get; set; }

        /// <summary>Survey attributes there, without gaps.</summary>
        public KeyValuePair<string, double>[] Attributes { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Position;
                case 1: return Normal;
                case 2: return (long)Segment;
                case 3: return (long)Region;
                case 4: return StableId.HasValue ? (object)(long)StableId.Value : null;
                case 5: return Label;
                case 6: return HeightM;
                case 7: return Attributes;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Position = (Vec3)value; return;
                case 1: Normal = (Vec3)value; return;
                case 2: Segment = (uint)(long)value; return;
                case 3: Region = (uint)(long)value; return;
                case 4: StableId = value == null ? (uint?)null : (uint)(long)value; return;
                case 5: Label = (string)value; return;
                case 6: HeightM = (double)value; return;
                case 7: Attributes = (KeyValuePair<string, double>[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>One seat of a group.</summary>
    public sealed class MemberPart : WirePart
    {
        internal static readonly Field[] Table =
        {
            new Field("member", true, new IntegerKind(1L, 4294967295L)),
            new Field("name", false, new TextKind(1, 64, null)),
            new Field("role", true, new ChoiceKind("guide", "member")),
            new Field("present", true, new FlagKind()),
            new Field("position", false, new PositionKind(10000000.0, false)),
        };

        /// <summary>Number in the group, never given again in it.</summary>
        public uint Member { get; set; }

        /// <summary>What it calls itself, for people. Null where absent.</summary>
        public string Name { get; set; }

        /// <summary>A group has one guide at most.</summary>
        public string Role { get; set; }

        /// <summary>False where its connection is lost and its seat is kept.</summary>
        public bool Present { get; set; }

        /// <summary>Centre of its last landing, metres of the scene frame (x, y, z); absent before the first. Null where absent.</summary>
        public Vec3? Position { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Member;
                case 1: return Name;
                case 2: return Role;
                case 3: return Present;
                case 4: return Position;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Member = (uint)(long)value; return;
                case 1: Name = (string)value; return;
                case 2: Role = (string)value; return;
                case 3: Present = (bool)value; return;
                case 4: Position = value == null ? (Vec3?)null : (Vec3)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>First message of a connection: who the client is, what it can take, what it holds.</summary>
    public sealed class HelloMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("protocol", true, new VersionKind()),
            new Field("client", true, new TextKind(0, 128, null)),
            new Field("token", false, new TextKind(0, 4096, null)),
            new Field("encoding", true, new ChoiceKind("segment-2")),
            new Field("budgets", true, new PartKind(() => new BudgetsPart(), "budgets")),
            new Field("credit_bytes", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("release_factor", false, new NumberKind(1.0, 4.0, false)),
            new Field("scene_version", false, new TextKind(0, 64, null)),
            new Field("held", false, new HeldKind(32768)),
            new Field("delivery", false, new ChoiceKind("push", "pull")),
            new Field("timings", false, new FlagKind()),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "hello"; }
        }

        /// <summary>Newest version that the client speaks.</summary>
        public ProtocolVersion Protocol { get; set; }

        /// <summary>Name and version of the client, for logs.</summary>
        public string Client { get; set; }

        /// <summary>Bearer token, where it was not given before. Null where absent.</summary>
        public string Token { get; set; }

        /// <summary>Payload encoding that the client wants.</summary>
        public string Encoding { get; set; }

        /// <summary>Hard bounds of every landing.</summary>
        public BudgetsPart Budgets { get; set; }

        /// <summary>First credit: payload bytes that may be sent at once.</summary>
        public long CreditBytes { get; set; }

        /// <summary>Release radius / load radius; absent means the server's default. Null where absent.</summary>
        public double? ReleaseFactor { get; set; }

        /// <summary>Scene version that the client knows; absent means the newest. Null where absent.</summary>
        public string SceneVersion { get; set; }

        /// <summary>Segments that the client holds whole, with their hashes. Null where absent.</summary>
        public HeldRow[] Held { get; set; }

        /// <summary>How payload comes: <c>push</c>, in frames of this connection; <c>pull</c>, fetched by the client (section 17). Absent means <c>push</c>. Null where absent.</summary>
        public string Delivery { get; set; }

        /// <summary>True: send timings with every ready; absent means false. Null where absent.</summary>
        public bool? Timings { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Protocol;
                case 1: return Client;
                case 2: return Token;
                case 3: return Encoding;
                case 4: return Budgets;
                case 5: return (long)CreditBytes;
                case 6: return ReleaseFactor;
                case 7: return SceneVersion;
                case 8: return Held;
                case 9: return Delivery;
                case 10: return Timings;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Protocol = (ProtocolVersion)value; return;
                case 1: Client = (string)value; return;
                case 2: Token = (string)value; return;
                case 3: Encoding = (string)value; return;
                case 4: Budgets = (BudgetsPart)value; return;
                case 5: CreditBytes = (long)(long)value; return;
                case 6: ReleaseFactor = value == null ? (double?)null : (double)value; return;
                case 7: SceneVersion = (string)value; return;
                case 8: Held = (HeldRow[])value; return;
                case 9: Delivery = (string)value; return;
                case 10: Timings = value == null ? (bool?)null : (bool)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The user points at a place: send ahead, at low priority, what a landing there needs.</summary>
    public sealed class AimMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("coarse_radius_m", false, new NumberKind(0.0, 1000000.0, true)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "aim"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>Centre in metres of the scene frame (x, y, z).</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius in metres around the centre.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m. Null where absent.</summary>
        public double? CoarseRadiusM { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return Position;
                case 2: return RadiusM;
                case 3: return CoarseRadiusM;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Position = (Vec3)value; return;
                case 2: RadiusM = (double)value; return;
                case 3: CoarseRadiusM = value == null ? (double?)null : (double)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The user teleports: answer with one plan, send its segments, say ready.</summary>
    public sealed class LandMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("inner_radius_m", false, new NumberKind(0.0, 1000000.0, true)),
            new Field("deadline_ms", false, new IntegerKind(1L, 600000L)),
            new Field("stall_ms", false, new IntegerKind(1L, 600000L)),
            new Field("coarse_radius_m", false, new NumberKind(0.0, 1000000.0, true)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "land"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>Centre in metres of the scene frame (x, y, z).</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius in metres around the centre.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius in metres of the degraded set; at most radius_m. Null where absent.</summary>
        public double? InnerRadiusM { get; set; }

        /// <summary>Milliseconds after which the inner set alone is acceptable; needs inner_radius_m. Null where absent.</summary>
        public int? DeadlineMs { get; set; }

        /// <summary>Milliseconds without progress after which it is, too; needs inner_radius_m. Null where absent.</summary>
        public int? StallMs { get; set; }

        /// <summary>Radius in metres of the coarser level: beyond radius_m up to it; at least radius_m. Null where absent.</summary>
        public double? CoarseRadiusM { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return Position;
                case 2: return RadiusM;
                case 3: return InnerRadiusM;
                case 4: return DeadlineMs.HasValue ? (object)(long)DeadlineMs.Value : null;
                case 5: return StallMs.HasValue ? (object)(long)StallMs.Value : null;
                case 6: return CoarseRadiusM;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Position = (Vec3)value; return;
                case 2: RadiusM = (double)value; return;
                case 3: InnerRadiusM = value == null ? (double?)null : (double)value; return;
                case 4: DeadlineMs = value == null ? (int?)null : (int)(long)value; return;
                case 5: StallMs = value == null ? (int?)null : (int)(long)value; return;
                case 6: CoarseRadiusM = value == null ? (double?)null : (double)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Grant more payload bytes.</summary>
    public sealed class CreditMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("bytes", true, new IntegerKind(1L, 9007199254740991L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "credit"; }
        }

        /// <summary>Payload bytes granted beyond what was before.</summary>
        public long Bytes { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Bytes;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Bytes = (long)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The client no longer holds these segments.</summary>
    public sealed class EvictMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("segments", true, new IdsKind(32768)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "evict"; }
        }

        /// <summary>Segments no longer held.</summary>
        public uint[] Segments { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Segments;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Segments = (uint[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>A segment arrived whole but is not usable.</summary>
    public sealed class RejectMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("segment", true, new IntegerKind(0L, 4294967295L)),
            new Field("reason", true, new TextKind(0, 64, null)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "reject"; }
        }

        /// <summary>Generation of the segment's last frame.</summary>
        public uint Generation { get; set; }

        /// <summary>The segment.</summary>
        public uint Segment { get; set; }

        /// <summary><c>hash_mismatch</c>, <c>undecodable</c>, or another word for logs.</summary>
        public string Reason { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return (long)Segment;
                case 2: return Reason;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Segment = (uint)(long)value; return;
                case 2: Reason = (string)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Ask what lies along a ray, or above or below a point.</summary>
    public sealed class PickMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("request", true, new IntegerKind(0L, 4294967295L)),
            new Field("origin", true, new PositionKind(10000000.0, false)),
            new Field("direction", false, new PositionKind(10000000.0, true)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "pick"; }
        }

        /// <summary>Number chosen by the client, for the answer.</summary>
        public uint Request { get; set; }

        /// <summary>Point in metres of the scene frame.</summary>
        public Vec3 Origin { get; set; }

        /// <summary>Direction of the ray, of any length; absent: the vertical line through origin. Null where absent.</summary>
        public Vec3? Direction { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Request;
                case 1: return Origin;
                case 2: return Direction;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Request = (uint)(long)value; return;
                case 1: Origin = (Vec3)value; return;
                case 2: Direction = value == null ? (Vec3?)null : (Vec3)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>More of what the client holds, after hello and before the first aim or land.</summary>
    public sealed class HeldMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("segments", true, new HeldKind(32768)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "held"; }
        }

        /// <summary>Segments that the client holds whole, with their hashes.</summary>
        public HeldRow[] Segments { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Segments;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Segments = (HeldRow[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The client ends the session; the server closes with 1000.</summary>
    public sealed class ByeMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "bye"; }
        }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            throw NoField(field);
        }
    }

    /// <summary>Take a seat in a group of this scene; it is made if there is none of that name.</summary>
    public sealed class JoinMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("request", true, new IntegerKind(0L, 4294967295L)),
            new Field("group", true, new TextKind(1, 64, "[A-Za-z0-9_.~-]+")),
            new Field("role", true, new ChoiceKind("guide", "member")),
            new Field("name", false, new TextKind(1, 64, null)),
            new Field("seat", false, new TextKind(1, 64, null)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "join"; }
        }

        /// <summary>Number chosen by the client, for the answer.</summary>
        public uint Request { get; set; }

        /// <summary>Name of the group, within the scene.</summary>
        public string Group { get; set; }

        /// <summary>A guide moves the group; one at most.</summary>
        public string Role { get; set; }

        /// <summary>What the others call this member. Null where absent.</summary>
        public string Name { get; set; }

        /// <summary>Secret of the seat held before, to take it again after a lost connection. Null where absent.</summary>
        public string Seat { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Request;
                case 1: return Group;
                case 2: return Role;
                case 3: return Name;
                case 4: return Seat;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Request = (uint)(long)value; return;
                case 1: Group = (string)value; return;
                case 2: Role = (string)value; return;
                case 3: Name = (string)value; return;
                case 4: Seat = (string)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Give up the seat in the group.</summary>
    public sealed class LeaveMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "leave"; }
        }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            throw NoField(field);
        }
    }

    /// <summary>The guide lands the group.</summary>
    public sealed class GatherMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("request", true, new IntegerKind(0L, 4294967295L)),
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("inner_radius_m", false, new NumberKind(0.0, 1000000.0, true)),
            new Field("deadline_ms", false, new IntegerKind(1L, 600000L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "gather"; }
        }

        /// <summary>Number chosen by the client, for the answer.</summary>
        public uint Request { get; set; }

        /// <summary>Centre in metres of the scene frame (x, y, z).</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius in metres around the centre.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius in metres of the degraded set; at most radius_m. Null where absent.</summary>
        public double? InnerRadiusM { get; set; }

        /// <summary>Milliseconds after which the barrier opens without who is missing; absent means the server's default. Null where absent.</summary>
        public int? DeadlineMs { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Request;
                case 1: return Position;
                case 2: return RadiusM;
                case 3: return InnerRadiusM;
                case 4: return DeadlineMs.HasValue ? (object)(long)DeadlineMs.Value : null;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Request = (uint)(long)value; return;
                case 1: Position = (Vec3)value; return;
                case 2: RadiusM = (double)value; return;
                case 3: InnerRadiusM = value == null ? (double?)null : (double)value; return;
                case 4: DeadlineMs = value == null ? (int?)null : (int)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>A member's part of a group landing is over.</summary>
    public sealed class ArrivedMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("gathering", true, new IntegerKind(1L, 4294967295L)),
            new Field("state", true, new ChoiceKind("ready", "degraded", "declined")),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "arrived"; }
        }

        /// <summary>Number of the group landing, chosen by the server.</summary>
        public uint Gathering { get; set; }

        /// <summary><c>ready</c>: shows its landing; <c>degraded</c>: its inner set; <c>declined</c>: will not come.</summary>
        public string State { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Gathering;
                case 1: return State;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Gathering = (uint)(long)value; return;
                case 1: State = (string)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to hello: the session is open.</summary>
    public sealed class WelcomeMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("protocol", true, new VersionKind()),
            new Field("server", true, new TextKind(0, 128, null)),
            new Field("session", true, new TextKind(0, 64, null)),
            new Field("scene", true, new PartKind(() => new SceneInfoPart(), "sceneinfo")),
            new Field("limits", true, new PartKind(() => new ServerLimitsPart(), "serverlimits")),
            new Field("release_factor", true, new NumberKind(1.0, 4.0, false)),
            new Field("dropped", true, new IdsKind(32768)),
            new Field("held_count", true, new IntegerKind(0L, 32768L)),
            new Field("pull", false, new PartKind(() => new PullInfoPart(), "pullinfo")),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "welcome"; }
        }

        /// <summary>Version spoken from now on.</summary>
        public ProtocolVersion Protocol { get; set; }

        /// <summary>Name and version of the server.</summary>
        public string Server { get; set; }

        /// <summary>Id of the session, for logs of both sides.</summary>
        public string Session { get; set; }

        /// <summary>The scene.</summary>
        public SceneInfoPart Scene { get; set; }

        /// <summary>What the server allows.</summary>
        public ServerLimitsPart Limits { get; set; }

        /// <summary>Release radius / load radius in use.</summary>
        public double ReleaseFactor { get; set; }

        /// <summary>Offered segments that this scene version does not have; the client frees them.</summary>
        public uint[] Dropped { get; set; }

        /// <summary>Offered segments that are accepted as held.</summary>
        public int HeldCount { get; set; }

        /// <summary>Where payload is fetched; present where hello asked for <c>pull</c> and the server grants it. Null where absent.</summary>
        public PullInfoPart Pull { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Protocol;
                case 1: return Server;
                case 2: return Session;
                case 3: return Scene;
                case 4: return Limits;
                case 5: return ReleaseFactor;
                case 6: return Dropped;
                case 7: return (long)HeldCount;
                case 8: return Pull;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Protocol = (ProtocolVersion)value; return;
                case 1: Server = (string)value; return;
                case 2: Session = (string)value; return;
                case 3: Scene = (SceneInfoPart)value; return;
                case 4: Limits = (ServerLimitsPart)value; return;
                case 5: ReleaseFactor = (double)value; return;
                case 6: Dropped = (uint[])value; return;
                case 7: HeldCount = (int)(long)value; return;
                case 8: Pull = (PullInfoPart)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to held: what of it is accepted.</summary>
    public sealed class HeldCheckedMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("dropped", true, new IdsKind(32768)),
            new Field("held_count", true, new IntegerKind(0L, 4294967295L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "held_checked"; }
        }

        /// <summary>Offered segments that this scene version does not have; the client frees them.</summary>
        public uint[] Dropped { get; set; }

        /// <summary>Segments that are held by now.</summary>
        public uint HeldCount { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Dropped;
                case 1: return (long)HeldCount;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Dropped = (uint[])value; return;
                case 1: HeldCount = (uint)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to land: the one set of segments of this landing.</summary>
    public sealed class PlanMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("release_radius_m", true, new NumberKind(0.0, 4000000.0, true)),
            new Field("effective_radius_m", true, new NumberKind(0.0, 1000000.0, false)),
            new Field("inner_count", true, new IntegerKind(0L, 16384L)),
            new Field("load", true, new LoadKind(16384)),
            new Field("keep", true, new IdsKind(16384)),
            new Field("nearby", true, new IdsKind(16384)),
            new Field("load_bytes", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("load_triangles", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("total_bytes", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("total_triangles", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("omitted_segments", true, new IntegerKind(0L, 4294967295L)),
            new Field("omitted_by", false, new ChoiceKind("max_triangles", "max_bytes", "max_segments", "max_gpu_bytes")),
            new Field("total_gpu_bytes", false, new IntegerKind(0L, 9007199254740991L)),
            new Field("blocks", false, new IdsKind(16384)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "plan"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>Centre, as received.</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius in metres around the centre.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius in metres within which held segments are kept.</summary>
        public double ReleaseRadiusM { get; set; }

        /// <summary>Everything nearer than this is shown: the largest radius, or less where a budget cut.</summary>
        public double EffectiveRadiusM { get; set; }

        /// <summary>Segments of the plan within inner_radius_m.</summary>
        public int InnerCount { get; set; }

        /// <summary>Segments within radius_m that follow, in sending order.</summary>
        public SegmentFacts[] Load { get; set; }

        /// <summary>Segments within radius_m that the client holds.</summary>
        public uint[] Keep { get; set; }

        /// <summary>Held segments beyond radius_m within release_radius_m: kept, not shown.</summary>
        public uint[] Nearby { get; set; }

        /// <summary>Payload bytes of load, whole segments.</summary>
        public long LoadBytes { get; set; }

        /// <summary>Triangles of load.</summary>
        public long LoadTriangles { get; set; }

        /// <summary>Payload bytes of load and keep.</summary>
        public long TotalBytes { get; set; }

        /// <summary>Triangles of load and keep.</summary>
        public long TotalTriangles { get; set; }

        /// <summary>Segments within radius_m that a budget left out.</summary>
        public uint OmittedSegments { get; set; }

        /// <summary>Budget that the first omitted segment would exceed; absent if none was omitted. Null where absent.</summary>
        public string OmittedBy { get; set; }

        /// <summary>GPU bytes of load, keep and nearby; present where hello bounds them. Null where absent.</summary>
        public long? TotalGpuBytes { get; set; }

        /// <summary>With <c>pull</c>: where the payload of each row begins in the pack, in blocks of 64 bytes. Null where absent.</summary>
        public uint[] Blocks { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return Position;
                case 2: return RadiusM;
                case 3: return ReleaseRadiusM;
                case 4: return EffectiveRadiusM;
                case 5: return (long)InnerCount;
                case 6: return Load;
                case 7: return Keep;
                case 8: return Nearby;
                case 9: return (long)LoadBytes;
                case 10: return (long)LoadTriangles;
                case 11: return (long)TotalBytes;
                case 12: return (long)TotalTriangles;
                case 13: return (long)OmittedSegments;
                case 14: return OmittedBy;
                case 15: return TotalGpuBytes.HasValue ? (object)(long)TotalGpuBytes.Value : null;
                case 16: return Blocks;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Position = (Vec3)value; return;
                case 2: RadiusM = (double)value; return;
                case 3: ReleaseRadiusM = (double)value; return;
                case 4: EffectiveRadiusM = (double)value; return;
                case 5: InnerCount = (int)(long)value; return;
                case 6: Load = (SegmentFacts[])value; return;
                case 7: Keep = (uint[])value; return;
                case 8: Nearby = (uint[])value; return;
                case 9: LoadBytes = (long)(long)value; return;
                case 10: LoadTriangles = (long)(long)value; return;
                case 11: TotalBytes = (long)(long)value; return;
                case 12: TotalTriangles = (long)(long)value; return;
                case 13: OmittedSegments = (uint)(long)value; return;
                case 14: OmittedBy = (string)value; return;
                case 15: TotalGpuBytes = value == null ? (long?)null : (long)(long)value; return;
                case 16: Blocks = (uint[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to aim: what is sent ahead.</summary>
    public sealed class PrefetchMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("segments", true, new LoadKind(16384)),
            new Field("bytes", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("blocks", false, new IdsKind(16384)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "prefetch"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>Segments, in sending order.</summary>
        public SegmentFacts[] Segments { get; set; }

        /// <summary>Payload bytes of segments, whole.</summary>
        public long Bytes { get; set; }

        /// <summary>With <c>pull</c>: where the payload of each row begins in the pack, in blocks of 64 bytes. Null where absent.</summary>
        public uint[] Blocks { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return Segments;
                case 2: return (long)Bytes;
                case 3: return Blocks;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Segments = (SegmentFacts[])value; return;
                case 2: Bytes = (long)(long)value; return;
                case 3: Blocks = (uint[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Every segment of the plan was sent whole, or is listed as missing.</summary>
    public sealed class ReadyMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("delivered", true, new IntegerKind(0L, 16384L)),
            new Field("payload_bytes", true, new IntegerKind(0L, 9007199254740991L)),
            new Field("missing", true, new IdsKind(16384)),
            new Field("timings", false, new PartKind(() => new TimingsPart(), "timings")),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "ready"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>Segments of load that were sent whole.</summary>
        public int Delivered { get; set; }

        /// <summary>Payload bytes sent in this generation's frames.</summary>
        public long PayloadBytes { get; set; }

        /// <summary>Segments of the plan that cannot be delivered.</summary>
        public uint[] Missing { get; set; }

        /// <summary>Where hello asked for them. Null where absent.</summary>
        public TimingsPart Timings { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return (long)Delivered;
                case 2: return (long)PayloadBytes;
                case 3: return Missing;
                case 4: return Timings;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Delivered = (int)(long)value; return;
                case 2: PayloadBytes = (long)(long)value; return;
                case 3: Missing = (uint[])value; return;
                case 4: Timings = (TimingsPart)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The deadline has passed and the inner set is whole; streaming goes on to ready.</summary>
    public sealed class DegradedMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("segments", true, new IdsKind(16384)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "degraded"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>The inner set: what may be shown already.</summary>
        public uint[] Segments { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return Segments;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: Segments = (uint[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>An unfinished generation was ended by a newer one.</summary>
    public sealed class SupersededMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("generation", true, new IntegerKind(0L, 4294967295L)),
            new Field("by", true, new IntegerKind(0L, 4294967295L)),
            new Field("unsent_bytes", true, new IntegerKind(0L, 9007199254740991L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "superseded"; }
        }

        /// <summary>Number of the aim or land; strictly increasing on one connection.</summary>
        public uint Generation { get; set; }

        /// <summary>The newer generation.</summary>
        public uint By { get; set; }

        /// <summary>Payload bytes that were not sent.</summary>
        public long UnsentBytes { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Generation;
                case 1: return (long)By;
                case 2: return (long)UnsentBytes;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Generation = (uint)(long)value; return;
                case 1: By = (uint)(long)value; return;
                case 2: UnsentBytes = (long)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to pick.</summary>
    public sealed class PickedMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("request", true, new IntegerKind(0L, 4294967295L)),
            new Field("hit", false, new PartKind(() => new HitPart(), "hit")),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "picked"; }
        }

        /// <summary>Request, as received.</summary>
        public uint Request { get; set; }

        /// <summary>What was met; absent if nothing was. Null where absent.</summary>
        public HitPart Hit { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Request;
                case 1: return Hit;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Request = (uint)(long)value; return;
                case 1: Hit = (HitPart)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>News that ends nothing by itself; a client skips kinds that it does not know.</summary>
    public sealed class NoticeMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("kind", true, new TextKind(1, 64, "[a-z][a-z0-9_]*")),
            new Field("version", false, new TextKind(0, 64, null)),
            new Field("reconnect_after_ms", false, new IntegerKind(0L, 9007199254740991L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "notice"; }
        }

        /// <summary><c>draining</c>: reconnect soon; <c>scene_published</c>: a newer version is served.</summary>
        public string Kind { get; set; }

        /// <summary>Version of the new scene. Null where absent.</summary>
        public string Version { get; set; }

        /// <summary>Milliseconds to wait before reconnecting. Null where absent.</summary>
        public long? ReconnectAfterMs { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Kind;
                case 1: return Version;
                case 2: return ReconnectAfterMs.HasValue ? (object)(long)ReconnectAfterMs.Value : null;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Kind = (string)value; return;
                case 1: Version = (string)value; return;
                case 2: ReconnectAfterMs = value == null ? (long?)null : (long)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Something was refused or failed.</summary>
    public sealed class ErrorMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("code", true, new TextKind(1, 64, "[a-z][a-z0-9_]*")),
            new Field("message", true, new TextKind(0, 1024, null)),
            new Field("fatal", true, new FlagKind()),
            new Field("generation", false, new IntegerKind(0L, 4294967295L)),
            new Field("request", false, new IntegerKind(0L, 4294967295L)),
            new Field("protocols", false, new VersionsKind(16)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "error"; }
        }

        /// <summary>Stable code, see the error codes.</summary>
        public string Code { get; set; }

        /// <summary>What was received and what was expected, for people.</summary>
        public string Message { get; set; }

        /// <summary>True: the server closes with the code's close code.</summary>
        public bool Fatal { get; set; }

        /// <summary>Generation of the refused aim or land. Null where absent.</summary>
        public uint? Generation { get; set; }

        /// <summary>Request of the refused pick, join or gather. Null where absent.</summary>
        public uint? Request { get; set; }

        /// <summary>With unsupported_version: the versions offered. Null where absent.</summary>
        public ProtocolVersion[] Protocols { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Code;
                case 1: return Message;
                case 2: return Fatal;
                case 3: return Generation.HasValue ? (object)(long)Generation.Value : null;
                case 4: return Request.HasValue ? (object)(long)Request.Value : null;
                case 5: return Protocols;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Code = (string)value; return;
                case 1: Message = (string)value; return;
                case 2: Fatal = (bool)value; return;
                case 3: Generation = value == null ? (uint?)null : (uint)(long)value; return;
                case 4: Request = value == null ? (uint?)null : (uint)(long)value; return;
                case 5: Protocols = (ProtocolVersion[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Answer to join: the seat in the group.</summary>
    public sealed class JoinedMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("request", true, new IntegerKind(0L, 4294967295L)),
            new Field("group", true, new TextKind(1, 64, "[A-Za-z0-9_.~-]+")),
            new Field("member", true, new IntegerKind(1L, 4294967295L)),
            new Field("role", true, new ChoiceKind("guide", "member")),
            new Field("seat", true, new TextKind(1, 64, null)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "joined"; }
        }

        /// <summary>Request, as received.</summary>
        public uint Request { get; set; }

        /// <summary>Name of the group, within the scene.</summary>
        public string Group { get; set; }

        /// <summary>Number of this member in the group.</summary>
        public uint Member { get; set; }

        /// <summary>As granted.</summary>
        public string Role { get; set; }

        /// <summary>Secret by which this seat is taken again, for this client alone.</summary>
        public string Seat { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Request;
                case 1: return Group;
                case 2: return (long)Member;
                case 3: return Role;
                case 4: return Seat;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Request = (uint)(long)value; return;
                case 1: Group = (string)value; return;
                case 2: Member = (uint)(long)value; return;
                case 3: Role = (string)value; return;
                case 4: Seat = (string)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Who is in the group, newest state; the ones between may be left out.</summary>
    public sealed class RosterMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("group", true, new TextKind(1, 64, "[A-Za-z0-9_.~-]+")),
            new Field("members", true, new PartsKind(() => new MemberPart(), 1024)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "roster"; }
        }

        /// <summary>Name of the group, within the scene.</summary>
        public string Group { get; set; }

        /// <summary>All seats, ascending number.</summary>
        public MemberPart[] Members { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return Group;
                case 1: return Members;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Group = (string)value; return;
                case 1: Members = Parts<MemberPart>(value); return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The guide lands the group: land there, then say arrived.</summary>
    public sealed class GatheringMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("gathering", true, new IntegerKind(1L, 4294967295L)),
            new Field("guide", true, new IntegerKind(1L, 4294967295L)),
            new Field("position", true, new PositionKind(10000000.0, false)),
            new Field("radius_m", true, new NumberKind(0.0, 1000000.0, true)),
            new Field("inner_radius_m", false, new NumberKind(0.0, 1000000.0, true)),
            new Field("left_ms", false, new IntegerKind(0L, 600000L)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "gathering"; }
        }

        /// <summary>Number of the group landing, chosen by the server.</summary>
        public uint Gathering { get; set; }

        /// <summary>Number of the member who asked for it.</summary>
        public uint Guide { get; set; }

        /// <summary>Centre in metres of the scene frame (x, y, z).</summary>
        public Vec3 Position { get; set; }

        /// <summary>Radius in metres around the centre.</summary>
        public double RadiusM { get; set; }

        /// <summary>Radius in metres of the degraded set. Null where absent.</summary>
        public double? InnerRadiusM { get; set; }

        /// <summary>Milliseconds until the barrier opens at the latest; absent where it has: nobody waits. Null where absent.</summary>
        public int? LeftMs { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Gathering;
                case 1: return (long)Guide;
                case 2: return Position;
                case 3: return RadiusM;
                case 4: return InnerRadiusM;
                case 5: return LeftMs.HasValue ? (object)(long)LeftMs.Value : null;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Gathering = (uint)(long)value; return;
                case 1: Guide = (uint)(long)value; return;
                case 2: Position = (Vec3)value; return;
                case 3: RadiusM = (double)value; return;
                case 4: InnerRadiusM = value == null ? (double?)null : (double)value; return;
                case 5: LeftMs = value == null ? (int?)null : (int)(long)value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>The barrier is open: everybody has arrived, or the deadline has passed.</summary>
    public sealed class GatheredMessage : WireMessage
    {
        internal static readonly Field[] Table =
        {
            new Field("gathering", true, new IntegerKind(1L, 4294967295L)),
            new Field("ready", true, new IdsKind(1024)),
            new Field("degraded", true, new IdsKind(1024)),
            new Field("missing", true, new IdsKind(1024)),
        };

        /// <inheritdoc/>
        public override string Type
        {
            get { return "gathered"; }
        }

        /// <summary>Number of the group landing, chosen by the server.</summary>
        public uint Gathering { get; set; }

        /// <summary>Members that show their landing.</summary>
        public uint[] Ready { get; set; }

        /// <summary>Members that show the inner set.</summary>
        public uint[] Degraded { get; set; }

        /// <summary>Members that declined, or did not arrive in time.</summary>
        public uint[] Missing { get; set; }

        internal override Field[] Fields
        {
            get { return Table; }
        }

        internal override object Get(int field)
        {
            switch (field)
            {
                case 0: return (long)Gathering;
                case 1: return Ready;
                case 2: return Degraded;
                case 3: return Missing;
            }
            throw NoField(field);
        }

        internal override void Set(int field, object value)
        {
            switch (field)
            {
                case 0: Gathering = (uint)(long)value; return;
                case 1: Ready = (uint[])value; return;
                case 2: Degraded = (uint[])value; return;
                case 3: Missing = (uint[])value; return;
            }
            throw NoField(field);
        }
    }

    /// <summary>Which messages there are in each direction.</summary>
    internal static class MessageTypes
    {
        internal static readonly string[] ClientToServer =
        {
            "hello",
            "aim",
            "land",
            "credit",
            "evict",
            "reject",
            "pick",
            "held",
            "bye",
            "join",
            "leave",
            "gather",
            "arrived",
        };

        internal static readonly string[] ServerToClient =
        {
            "welcome",
            "held_checked",
            "plan",
            "prefetch",
            "ready",
            "degraded",
            "superseded",
            "picked",
            "notice",
            "error",
            "joined",
            "roster",
            "gathering",
            "gathered",
        };

        /// <summary>An empty message; null where that direction has none.</summary>
        internal static WireMessage Create(Direction direction, string type)
        {
            if (direction == Direction.ClientToServer)
            {
                switch (type)
                {
                    case "hello": return new HelloMessage();
                    case "aim": return new AimMessage();
                    case "land": return new LandMessage();
                    case "credit": return new CreditMessage();
                    case "evict": return new EvictMessage();
                    case "reject": return new RejectMessage();
                    case "pick": return new PickMessage();
                    case "held": return new HeldMessage();
                    case "bye": return new ByeMessage();
                    case "join": return new JoinMessage();
                    case "leave": return new LeaveMessage();
                    case "gather": return new GatherMessage();
                    case "arrived": return new ArrivedMessage();
                }
            }
            if (direction == Direction.ServerToClient)
            {
                switch (type)
                {
                    case "welcome": return new WelcomeMessage();
                    case "held_checked": return new HeldCheckedMessage();
                    case "plan": return new PlanMessage();
                    case "prefetch": return new PrefetchMessage();
                    case "ready": return new ReadyMessage();
                    case "degraded": return new DegradedMessage();
                    case "superseded": return new SupersededMessage();
                    case "picked": return new PickedMessage();
                    case "notice": return new NoticeMessage();
                    case "error": return new ErrorMessage();
                    case "joined": return new JoinedMessage();
                    case "roster": return new RosterMessage();
                    case "gathering": return new GatheringMessage();
                    case "gathered": return new GatheredMessage();
                }
            }
            return null;
        }
    }
}
