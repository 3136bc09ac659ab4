using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Threading;

namespace Terraport.Tools
{
    /// <summary>
    /// Visits a scene step by step, and prints one JSON object: events, picks, what would be drawn, and digests of it. Exit code 0 where the
    /// last landing was shown.
    /// </summary>
    internal sealed class Visit
    {
        public const string Usage = "       terraport-tools land --scene URL [--NAME VALUE ...] STEP ...\n"
            + "  --token T  --token-file PATH (read again for each connection)  --max-triangles N  --max-bytes N  --max-segments N\n"
            + "  --cache-bytes N  --credit-bytes N  --spare-bytes N  --disk FOLDER  --disk-bytes N  --decode-threads N  --timeout-s S\n"
            + "  --ring 0|1  --images 0|1  --show 0|1 (0: landings are made ready and not shown)\n"
            + "  --dump FOLDER (normals of what is shown)\n"
            + "steps: land:X,Y,Z,RADIUS[,INNER,DEADLINE_MS] (until shown, or ready for it)  start:... (until planned)\n"
            + "       wait (until shown and answered)  aim:X,Y,Z,RADIUS\n"
            + "       pick:X,Y,Z[,DX,DY,DZ]  stand:X,Y,Z (height and segment of the ground shown)  pause:MS  reconnect[:TOKEN]\n"
            + "       base:0|1 (0: its upload does not end)\n"
            + "       join:NAME,guide|member[,OWN_NAME]  leave  people:N  follow:0|1  gather:X,Y,Z,RADIUS  barrier:N\n";

        private const double FrameMs = 2, SolidHalfM = 4;
        private const int SolidFaces = 4096;

        private readonly Stopwatch watch = Stopwatch.StartNew();
        private readonly List<object> events = new List<object>(), picks = new List<object>(), feet = new List<object>();
        private readonly RecordingRenderer renderer;
        private readonly SceneClient client;
        private readonly GroupFollower follower;
        private readonly double timeoutS;
        private string failure, refusal, closed;

        private Visit(SceneFiles files, SceneClientOptions options, double timeoutS, bool readsImages)
        {
            this.timeoutS = timeoutS;
            renderer = new RecordingRenderer(files.Manifest.Attributes, readsImages);
            client = new SceneClient(options, files, renderer, 24);
            follower = new GroupFollower(client);
            client.Planned += plan => Note("planned", plan.Landing, "load_bytes", plan.LoadBytes, "total_bytes", plan.TotalBytes,
                "triangles", plan.TotalTriangles, "segments", plan.Segments, "coarser", plan.CoarserSegments, "load", plan.LoadSegments,
                "omitted", plan.OmittedSegments, "omitted_by", plan.OmittedBy, "effective_radius_m", plan.EffectiveRadiusM);
            client.Ready += landing => Note("ready", landing, "missing", client.Status.Missing);
            client.Degraded += landing => Note("degraded", landing);
            client.Presentable += landing => Note("presentable", landing);
            client.Shown += swap => Note("shown", swap.Landing, "segments", swap.Segments, "hidden", swap.HiddenBaseFaces, "degraded",
                swap.IsDegraded, "frame_bytes", client.Stats.PayloadBytes);
            client.Picked += (request, hit) => picks.Add(hit == null ? null : ShownMessage.FieldsOf(hit));
            client.Failed += error =>
            {
                // A segment that cannot be drawn does not end the landing.
                if (client.Status.Phase == LandingPhase.Refused) refusal = error.Code;
                Note("failed", 0, "code", error.Code);
            };
            client.LinkChanged += link =>
            {
                closed = link.Phase == LinkPhase.Closed ? link.Code : null;
                Note("link", 0, "state", link.Phase.ToString().ToLowerInvariant(), "attempt", link.Attempt, "retry_in_ms", link.RetryInMs,
                    "close_code", link.CloseCode, "code", link.Code);
            };
            client.GroupChanged += change => NoteGroup(change);
            client.GroupRefused += (code, message) =>
            {
                refusal = code;
                Note("group_refused", 0, "code", code);
            };
        }

        public static int Run(string[] arguments)
        {
            var named = new Dictionary<string, string>();
            int at = 0;
            for (; at + 1 < arguments.Length && arguments[at].StartsWith("--", StringComparison.Ordinal); at += 2)
            {
                named[arguments[at].Substring(2)] = arguments[at + 1];
            }
            var options = new SceneClientOptions { DiskFolder = Text(named, "disk"), DiskBytes = Number(named, "disk-bytes") ?? 1 << 30 };
            options.DecodeThreads = (int)(Number(named, "decode-threads") ?? 2);
            options.SpareGpuBytes = Number(named, "spare-bytes") ?? options.SpareGpuBytes;
            options.ShowsCoarse = Number(named, "ring") != 0;
            options.AutoShow = Number(named, "show") != 0;
            options.Session.CreditBytes = Number(named, "credit-bytes") ?? options.Session.CreditBytes;
            options.Session.CacheBytes = Number(named, "cache-bytes") ?? options.Session.CacheBytes;
            options.Session.Budgets.MaxTriangles = Number(named, "max-triangles");
            options.Session.Budgets.MaxBytes = Number(named, "max-bytes");
            options.Session.Budgets.MaxSegments = Number(named, "max-segments");
            string tokenFile = Text(named, "token-file");
            options.Token = () => tokenFile == null ? Text(named, "token") : File.ReadAllText(tokenFile);
            Visit visit = null;
            string failed = null;
            try
            {
                SceneFiles files = SceneFiles.LoadAsync(named["scene"], options.Token(), new SystemHttp()).GetAwaiter().GetResult();
                visit = new Visit(files, options, Number(named, "timeout-s") ?? 60, Number(named, "images") != 0);
                foreach (string step in arguments.Skip(at)) visit.Take(step);
                failed = visit.failure;
            }
            catch (TerraportException error)
            {
                failed = error.Code + ": " + error.Message;
                if (visit != null) visit.failure = failed;
            }
            Console.WriteLine(visit == null ? "{\"failure\":" + Canonical.Text(failed) + "}" : visit.Describe(Text(named, "dump")));
            visit?.client.Dispose();
            return failed == null ? 0 : 1;
        }

        private static string Text(Dictionary<string, string> named, string name)
        {
            return named.TryGetValue(name, out string text) ? text : null;
        }

        private static long? Number(Dictionary<string, string> named, string name)
        {
            return named.TryGetValue(name, out string text) ? (long?) double.Parse(text, CultureInfo.InvariantCulture) : null;
        }

        private void Take(string step)
        {
            int colon = step.IndexOf(':');
            string kind = colon < 0 ? step : step.Substring(0, colon), argument = colon < 0 ? "" : step.Substring(colon + 1);
            string[] fields = argument.Split(',');
            double[] numbers =
                fields.Select(field => double.TryParse(field, NumberStyles.Float, CultureInfo.InvariantCulture, out double n) ? n : 0)
                    .ToArray();
            var place = numbers.Length < 3 ? default : new Vec3(numbers[0], numbers[1], numbers[2]);
            LandingPhase last = client.AutoShow ? LandingPhase.Shown : LandingPhase.Presentable;
            int count;
            switch (kind)
            {
                case "land":
                case "start":
                    client.Land(place, numbers[3],
                        numbers.Length < 6 ? null : new LandOptions { InnerRadiusM = numbers[4], DeadlineMs = numbers[5] });
                    Until(step, () => kind == "start" ? client.Status.Plan != null : client.Status.Phase == last, true);
                    break;
                case "wait": Until(step, () => client.Status.Phase == LandingPhase.Shown && client.Status.ReadyMs != null, true); break;
                case "aim": client.Aim(place, numbers[3]); break;
                case "pick":
                    count = picks.Count;
                    client.Pick(place, numbers.Length < 6 ? (Vec3?)null : new Vec3(numbers[3], numbers[4], numbers[5]));
                    Until(step, () => picks.Count > count, true);
                    break;
                case "stand": feet.Add(Stand(place)); break;
                case "pause":
                    double endMs = watch.Elapsed.TotalMilliseconds + numbers[0];
                    Until(step, () => watch.Elapsed.TotalMilliseconds >= endMs, false);
                    break;
                case "base": renderer.IsBaseHeld = numbers[0] == 0; break;
                case "reconnect":
                    closed = null;
                    client.Reconnect(argument.Length == 0 ? null : argument);
                    break;
                case "join":
                    GroupRole role = fields.Length > 1 && fields[1] == "guide" ? GroupRole.Guide : GroupRole.Member;
                    client.Group.Join(fields[0], role, fields.Length > 2 ? fields[2] : null);
                    Until(step, () => follower.Group != null, true);
                    break;
                case "leave": client.Group.Leave(); break;
                case "people": Until(step, () => follower.Group?.Members.Count >= numbers[0], true); break;
                case "follow": follower.Follows = numbers[0] != 0; break;
                case "gather":
                    count = events.Count;
                    client.Group.Gather(place, numbers[3]);
                    Until(step, () => events.Skip(count).Any(one => IsCalled(one)), true);
                    break;
                case "barrier":
                    Until(step, () => follower.Group?.Gathering?.Number >= numbers[0] && follower.Group.Gathering.IsOver, true);
                    break;
                default: throw new TerraportException("usage", "got step " + step);
            }
        }

        private static bool IsCalled(object one) { return (string)((Dictionary<string, object>)one)["type"] == "group_called"; }

        /// <summary>One frame after the other until something holds. What ends a step early is the failure; a later step that succeeds clears it.</summary>
        private void Until(string step, Func<bool> isReached, bool canFail)
        {
            refusal = null;
            while (!isReached())
            {
                string reason = watch.Elapsed.TotalSeconds > timeoutS ? "timeout"
                    : !canFail                                        ? null
                    : closed != null                                  ? "closed: " + closed
                    : refusal != null                                 ? "refused: " + refusal
                                                                      : null;
                if (reason != null)
                {
                    failure = step + ": " + reason;
                    return;
                }
                client.Update(FrameMs);
                follower.Update();
                if (client.NeedsFiles) failure = "another version is served";
                Thread.Sleep(1);
            }
            if (canFail) failure = null;
        }

        private void Note(string type, int landing, params object[] fields)
        {
            var one = new Dictionary<string, object> { { "type", type }, { "landing", landing } };
            for (int at = 0; at < fields.Length; at += 2) one[(string)fields[at]] = fields[at + 1];
            events.Add(one);
        }

        private void NoteGroup(GroupChange change)
        {
            Group group = follower.Group;
            if (group == null) return;
            GroupGathering there = group.Gathering;
            object gathering = there == null ? null
                                             : new Dictionary<string, object> {
                                                   { "number", there.Number },
                                                   { "position", ShownMessage.Numbers(there.Position) },
                                                   { "radius_m", there.RadiusM },
                                                   { "over", there.IsOver },
                                                   { "ready", there.Ready },
                                                   { "missing", there.Missing },
                                               };
            Note("group_" + change.ToString().ToLowerInvariant(), 0, "member", group.Member, "members",
                group.Members.Select(ShownMessage.FieldsOf).ToList(), "gathering", gathering);
        }

        /// <summary>Height of the ground that is shown at a place, its segment (-1 for the base), and the height of what is solid there.</summary>
        private object Stand(Vec3 place)
        {
            if (!client.Ground.At(place, out GroundPoint point)) return null;
            var solid = new List<float>();
            client.Ground.Gather(point.Position, SolidHalfM, SolidFaces, solid);
            double highest = -1e6;
            for (int at = 0; at < solid.Count; at += 9)
            {
                Func<int, Vec3> corner = n => new Vec3(solid[at + 3 * n], solid[at + 3 * n + 1], solid[at + 3 * n + 2]);
                Vec3 a = corner(0), u = corner(1) - a, v = corner(2) - a, p = point.Position - a;
                double area = u.X * v.Z - u.Z * v.X, beta = (p.X * v.Z - p.Z * v.X) / area, gamma = (u.X * p.Z - u.Z * p.X) / area;
                if (beta >= -1e-9 && gamma >= -1e-9 && beta + gamma <= 1 + 1e-9)
                    highest = Math.Max(highest, a.Y + beta * u.Y + gamma * v.Y);
            }
            return new object[] { point.Position.Y, point.Segment.HasValue ? (long)point.Segment.Value : -1, highest };
        }

        private string Describe(string dumpFolder)
        {
            var segments = new Dictionary<string, object>();
            foreach (Wire.PlanRow row in client.ShownRows)
            {
                MeshArrays arrays = renderer.Of(row.Key);
                segments[row.Id.ToString()] = arrays.Digests;
                if (dumpFolder != null) File.WriteAllBytes(Path.Combine(dumpFolder, row.Id + ".normals"), MeshArrays.Bytes(arrays.Normals));
            }
            StreamStats stats = client.Stats;
            return Canonical.Text(new Dictionary<string, object> {
                { "events", events },
                { "picks", picks },
                { "feet", feet },
                { "segments", segments },
                { "visible", client.ShownRows.Select(row => row.Id).OrderBy(id => id).ToArray() },
                { "hidden_base_faces", renderer.HiddenFaces.ToArray() },
                { "swaps", renderer.Swaps },
                { "uploaded", renderer.Uploaded },
                { "faults", renderer.Faults },
                { "connections", client.Connections },
                { "payload_bytes", stats.PayloadBytes },
                { "repeated_bytes", stats.RepeatedBytes },
                { "held_bytes", stats.HeldBytes },
                { "held_segments", stats.HeldSegments },
                { "failure", failure },
            });
        }
    }
}
