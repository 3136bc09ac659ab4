using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport.Wire
{
    /// <summary>A message from the service (spec/protocol.md, section 3).</summary>
    internal abstract class ServerMessage
    {
        private const double MaxRadiusM = 1e6, MaxRate = 1e9;
        private const int MaxPlanSegments = 16384, MaxBytes = 8 * 1024 * 1024, MaxMembers = 1024, MaxDeadlineMs = 600000,
                          MaxAttributes = 64;

        /// <summary>Read a message; null where its type is not known.</summary>
        /// <exception cref="WireException">It is not what the protocol says.</exception>
        internal static ServerMessage Read(ArraySegment<byte> message)
        {
            if (message.Count > MaxBytes) throw new WireException("got " + message.Count + " bytes, expected at most " + MaxBytes);
            Dictionary<string, object> map = MsgpackReader.ReadMap(message);
            string type = new Fields(map, "message").Text("type", int.MaxValue);
            var fields = new Fields(map, type);
            switch (type)
            {
                case "welcome": return ReadWelcome(fields);
                case "plan": return ReadPlan(fields);
                case "ready":
                    return new Ready {
                        Generation = fields.Unsigned("generation"),
                        Missing = fields.Has("missing") ? Keys(fields.Binary("missing", 8, MaxPlanSegments)) : null,
                        Hidden = Bits(fields, "hidden"),
                    };
                case "picked":
                    return new Picked {
                        Request = fields.Unsigned("request"),
                        Hit = fields.Has("hit") ? ReadHit(fields.Part("hit")) : null,
                    };
                case "notice":
                    return new Notice {
                        Kind = fields.Text("kind", 64, 1),
                        ReconnectAfterMs = fields.OptionalInteger("reconnect_after_ms", 0, Fields.MaxInteger),
                        Version = fields.OptionalText("version", 64),
                    };
                case "error":
                    return new Error {
                        Code = fields.Text("code", 64, 1),
                        Message = fields.Text("message", 1024),
                        IsFatal = fields.Flag("fatal"),
                        Generation = fields.OptionalUnsigned("generation"),
                        Request = fields.OptionalUnsigned("request"),
                    };
                case "joined":
                    return new Joined {
                        Request = fields.Unsigned("request"),
                        Group = GroupName(fields),
                        Member = fields.Unsigned("member", 1),
                        Role = Role(fields),
                        Seat = fields.Text("seat", 64, 1),
                    };
                case "roster":
                    return new Roster {
                        Group = GroupName(fields),
                        Members = fields.Parts("members", MaxMembers).Select(ReadMember).ToArray(),
                    };
                case "gathering":
                    return new Gathering {
                        Number = fields.Unsigned("gathering", 1),
                        Guide = fields.Unsigned("guide", 1),
                        Position = fields.Point("position"),
                        RadiusM = fields.Number("radius_m", 0, MaxRadiusM, true),
                        InnerRadiusM = fields.OptionalNumber("inner_radius_m", 0, MaxRadiusM, true),
                        LeftMs = fields.OptionalInteger("left_ms", 0, MaxDeadlineMs),
                    };
                case "gathered":
                    return new Gathered {
                        Number = fields.Unsigned("gathering", 1),
                        Ready = Ids(fields.Binary("ready", 4, MaxMembers)),
                        Degraded = Ids(fields.Binary("degraded", 4, MaxMembers)),
                        Missing = Ids(fields.Binary("missing", 4, MaxMembers)),
                    };
                default: return null;
            }
        }

        private static Welcome ReadWelcome(Fields fields)
        {
            Fields scene = fields.Part("scene"), limits = fields.Part("limits");
            return new Welcome {
                Session = fields.OptionalText("session", 64),
                SceneId = scene.Text("id", 128, 1),
                SceneName = scene.OptionalText("name", 256),
                Version = scene.Text("version", 64, 1),
                SegmentCount = scene.Unsigned("segment_count"),
                BaseFaces = scene.Unsigned("base_faces"),
                Levels = (int)scene.Integer("levels", 1, 2),
                MaxRadiusM = limits.Number("max_radius_m", 0, MaxRadiusM),
                MaxMessageBytes = limits.Integer("max_message_bytes", 1, Fields.MaxInteger),
                MaxMessagesPerS = limits.Number("max_messages_per_s", 0, MaxRate),
                MaxCreditBytes = limits.Integer("max_credit_bytes", 1, Fields.MaxInteger),
                IdleTimeoutS = limits.Number("idle_timeout_s", 0, MaxRate),
                Groups = limits.Choice("groups", "none", "here", "query"),
            };
        }

        private static Plan ReadPlan(Fields fields)
        {
            ArraySegment<byte> rows = fields.Binary("show", PlanRow.Bytes, MaxPlanSegments);
            var show = new PlanRow[rows.Count / PlanRow.Bytes];
            for (int row = 0; row < show.Length; row++) show[row] = PlanRow.Read(rows.Array, rows.Offset + row * PlanRow.Bytes);
            return new Plan {
                Generation = fields.Unsigned("generation"),
                Show = show,
                Hidden = fields.Binary("hidden", 1, MaxBytes),
                InnerCount = (int?)fields.OptionalInteger("inner_count", 0, MaxPlanSegments),
                InnerHidden = Bits(fields, "inner_hidden"),
                EffectiveRadiusM = fields.Number("effective_radius_m", 0, MaxRadiusM),
                Omitted = fields.Unsigned("omitted"),
                OmittedBy = fields.OptionalChoice("omitted_by", "max_triangles", "max_bytes", "max_segments", "max_gpu_bytes"),
            };
        }

        private static PickHit ReadHit(Fields hit)
        {
            return new PickHit {
                Position = hit.Point("position"),
                Normal = hit.Point("normal", 1.5),
                HeightM = hit.Number("height_m", -1e9, 1e9),
                Segment = hit.Unsigned("segment"),
                Region = hit.OptionalUnsigned("region"),
                StableId = hit.OptionalUnsigned("stable_id"),
                Label = hit.OptionalText("label", 256),
                Attributes = hit.Numbers("attributes", MaxAttributes),
            };
        }

        private static GroupMember ReadMember(Fields member)
        {
            return new GroupMember {
                Member = member.Unsigned("member", 1),
                Name = member.OptionalText("name", 64, 1),
                Role = Role(member),
                IsPresent = member.Flag("present"),
                Position = member.OptionalPoint("position"),
            };
        }

        private static string GroupName(Fields fields)
        {
            string name = fields.Text("group", 64, 1);
            return Terraport.Group.IsName(name) ? name : throw new WireException("got group " + name + ", expected A-Z a-z 0-9 _ . ~ -");
        }

        private static GroupRole Role(Fields fields)
        {
            return fields.Choice("role", "guide", "member") == "guide" ? GroupRole.Guide : GroupRole.Member;
        }

        private static ArraySegment<byte> Bits(Fields fields, string key)
        {
            return fields.Has(key) ? fields.Binary(key, 1, MaxBytes) : default;
        }

        private static ulong[] Keys(ArraySegment<byte> table)
        {
            return Enumerable.Range(0, table.Count / 8).Select(at => LittleEndian.ReadU64(table.Array, table.Offset + 8 * at)).ToArray();
        }

        private static uint[] Ids(ArraySegment<byte> table)
        {
            return Enumerable.Range(0, table.Count / 4).Select(at => LittleEndian.ReadU32(table.Array, table.Offset + 4 * at)).ToArray();
        }
    }

    /// <summary>The session is open.</summary>
    internal sealed class Welcome : ServerMessage
    {
        internal string Session, SceneId, SceneName, Version, Groups;
        internal uint SegmentCount, BaseFaces;
        internal int Levels;
        internal double MaxRadiusM, MaxMessagesPerS, IdleTimeoutS;
        internal long MaxMessageBytes, MaxCreditBytes;
    }

    /// <summary>What a landing shows, and which base faces are hidden.</summary>
    internal sealed class Plan : ServerMessage
    {
        internal uint Generation, Omitted;
        /// <summary>Nearest first.</summary>
        internal PlanRow[] Show;
        /// <summary>One bit a base face, in a gzip stream. A view of the message: valid while it is taken.</summary>
        internal ArraySegment<byte> Hidden, InnerHidden;
        internal int? InnerCount;
        internal double EffectiveRadiusM;
        internal string OmittedBy;
    }

    /// <summary>One segment of a plan.</summary>
    internal struct PlanRow
    {
        internal const int Bytes = 28;

        internal ulong Key;
        internal uint Id, PayloadBytes, Faces, Vertices;

        /// <summary>Whether it is sent: the client has not named it in "have".</summary>
        internal bool IsSent;

        /// <summary>Whether it is of the coarser level.</summary>
        internal bool IsCoarser;

        internal static PlanRow Read(byte[] bytes, int at)
        {
            uint flags = LittleEndian.ReadU32(bytes, at + 24);
            return new PlanRow {
                Key = LittleEndian.ReadU64(bytes, at),
                Id = LittleEndian.ReadU32(bytes, at + 8),
                PayloadBytes = LittleEndian.ReadU32(bytes, at + 12),
                Faces = LittleEndian.ReadU32(bytes, at + 16),
                Vertices = LittleEndian.ReadU32(bytes, at + 20),
                IsSent = (flags & 1) != 0,
                IsCoarser = (flags & 2) != 0,
            };
        }
    }

    /// <summary>Everything of a landing was sent.</summary>
    internal sealed class Ready : ServerMessage
    {
        internal uint Generation;
        /// <summary>Keys that cannot be delivered; null without any.</summary>
        internal ulong[] Missing;
        internal ArraySegment<byte> Hidden;
    }

    internal sealed class Picked : ServerMessage
    {
        internal uint Request;
        internal PickHit Hit;
    }

    internal sealed class Notice : ServerMessage
    {
        internal string Kind, Version;
        internal long? ReconnectAfterMs;
    }

    internal sealed class Error : ServerMessage
    {
        internal string Code, Message;
        internal bool IsFatal;
        internal uint? Generation, Request;
    }

    internal sealed class Joined : ServerMessage
    {
        internal uint Request, Member;
        internal string Group, Seat;
        internal GroupRole Role;
    }

    internal sealed class Roster : ServerMessage
    {
        internal string Group;
        internal GroupMember[] Members;
    }

    internal sealed class Gathering : ServerMessage
    {
        internal uint Number, Guide;
        internal Vec3 Position;
        internal double RadiusM;
        internal double? InnerRadiusM;
        internal long? LeftMs;
    }

    internal sealed class Gathered : ServerMessage
    {
        internal uint Number;
        internal uint[] Ready, Degraded, Missing;
    }
}
