using System;
using System.Collections;
using System.Collections.Generic;
using System.IO;
using System.Linq;
using System.Text;
using Terraport.Json;
using Terraport.Sessions;

namespace Terraport.Tools
{
    /// <summary>Runs tests/conformance/session: each step of a history must do what the Python client did.</summary>
    internal sealed class SessionCorpus
    {
        private readonly string folder;
        private string[] messages;
        private ClientSession session;
        // What the client showed and held after the step before, as JSON.
        private readonly Dictionary<string, string> before = new Dictionary<string, string>();

        public SessionCorpus(string folder) { this.folder = folder; }

        public int Run()
        {
            var tally = new Tally();
            foreach (string path in Directory.GetFiles(folder, "*.jsonl").OrderBy(name => name, StringComparer.Ordinal))
            {
                string name = null, failure = null;
                foreach (string line in File.ReadAllLines(path))
                {
                    JsonValue row = JsonReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(line)));
                    if (!row["messages"].IsNull) messages = Items(row["messages"]).Select(text => text.Text).ToArray();
                    if (!row["history"].IsNull)
                    {
                        if (name != null) tally.Add(name, failure);
                        name = row["history"].Text;
                        failure = null;
                        Begin(row["options"]);
                    }
                    if (row["do"].IsNull || failure != null) continue;
                    // Compared as text: the file is compact, and has its keys in this order.
                    string told = Told(Items(row["do"]));
                    int at = line.IndexOf(",\"told\":", StringComparison.Ordinal) + 8;
                    string expected = line.Substring(at, line.Length - at - 1);
                    if (told != expected) failure = row["do"][0].Text + ": got " + told + ", expected " + expected;
                }
                tally.Add(name, failure);
            }
            return tally.Finish();
        }

        private void Begin(JsonValue options)
        {
            before["visible"] = before["held"] = "[]";
            before["unfinished"] = "null";
            before["aims"] = "[0,0,0,0]";
            long? triangles = Integer(options["max_triangles"]), bytes = Integer(options["max_bytes"]);
            session = new ClientSession(new SessionOptions {
                Client = "corpus",
                Budgets = new Budgets { MaxTriangles = triangles, MaxBytes = bytes, MaxSegments = Integer(options["max_segments"]) },
                CreditBytes = Integer(options["credit_bytes"]).Value,
                ReleaseFactor = options["release_factor"].IsNull ? (double?)null : Number(options["release_factor"]),
                CacheBytes = Integer(options["cache_bytes"]).Value,
            });
        }

        /// <summary>Do one step; what came of it.</summary>
        private string Told(JsonValue[] given)
        {
            var told = new List<string>();
            try
            {
                int[] sent = Perform(given);
                if (sent.Length > 0) told.Add("\"out\":" + Json(sent));
            }
            catch (ProtocolViolationException)
            {
                told.Add("\"violation\":true");
            }
            catch (ArgumentException)
            {
                told.Add("\"refused\":true");
            }
            var rows = new List<object[]>();
            StreamEvent news;
            while (session.TryNextEvent(out news)) rows.Add(RowOf(news));
            rows.RemoveAll(row => row == null);
            if (rows.Count > 0) told.Add("\"events\":" + Json(rows));
            Note("visible", session.Visible, told);
            // The corpus' scenes have 36 segments at up to two levels.
            Note("held", Enumerable.Range(0, 72).Where(id => session.Cache.Contains((uint)id)), told);
            Note("unfinished", session.Unfinished, told);
            StreamStats stats = session.Stats;
            Note("aims", new[] { stats.AimedLandings, stats.AimHits, stats.PrefetchedBytes, stats.UsedPrefetchedBytes }, told);
            return "{" + string.Join(",", told) + "}";
        }

        private void Note(string key, object now, List<string> told)
        {
            string text = Json(now);
            if (before[key] != text) told.Add("\"" + key + "\":" + text);
            before[key] = text;
        }

        /// <summary>Do one step; the numbers of the messages that are taken to be sent.</summary>
        private int[] Perform(JsonValue[] given)
        {
            bool flag = false;
            var sent = new Queue<byte[]>();
            switch (given[0].Text)
            {
                case "take": session.TakeMessages(sent); break;
                case "receive": Receive(Convert.FromBase64String(messages[Integer(given[1]).Value]), false); break;
                case "text": Receive(Encoding.UTF8.GetBytes(given[1].Text), true); break;
                case "connected": session.Connected(given[1].TryFlag(out flag) && flag); break;
                case "lost": session.ConnectionLost(); break;
                case "land":
                    var options = new LandOptions { InnerRadiusM = Real(given[3]), DeadlineMs = (int?)Integer(given[4]) };
                    if (given.Length > 5) options.CoarseRadiusM = Real(given[5]);
                    session.Land(Point(given[1]), Number(given[2]), options);
                    break;
                case "aim": session.Aim(Point(given[1]), Number(given[2]), given.Length > 3 ? Real(given[3]) : null); break;
                case "flush": session.FlushAim(); break;
                case "pick": session.Pick(Point(given[1]), given[2].IsNull ? (Vec3?)null : Point(given[2])); break;
                case "bye": session.Bye(); break;
                case "join": session.Join(given[1].Text, Named<GroupRole>(given[2]), given[3].Text); break;
                case "leave": session.Leave(); break;
                case "gather": session.Gather(Point(given[1]), Number(given[2]), Real(given[3]), (int?)Integer(given[4])); break;
                case "arrived": session.Arrive((uint)Integer(given[1]).Value, Named<GroupArrival>(given[2])); break;
                default: throw new InvalidDataException("step " + given[0].Text);
            }
            return sent.Select(data => Array.IndexOf(messages, Convert.ToBase64String(data))).ToArray();
        }

        private void Receive(byte[] data, bool isText) { session.Receive(new ArraySegment<byte>(data), isText); }

        /// <summary>An event as the corpus tells it; null for those that clients name in their own ways.</summary>
        private static object[] RowOf(StreamEvent told)
        {
            PlanFacts plan = told.Plan;
            GroupFacts group = told.Group;
            GroupGathering there = group == null ? null : group.Gathering;
            switch (told.Kind)
            {
                case StreamEventKind.Opened: return Row("opened", told.IsChanged, told.HeldCount);
                case StreamEventKind.Planned:
                    return Row("planned", told.Landing, plan.Load.Select(facts => facts.Segment), plan.Keep, plan.Nearby);
                case StreamEventKind.Arrived: return Row("arrived", told.Landing, told.Facts.Segment);
                case StreamEventKind.Degraded: return Row("degraded", told.Landing, told.Segments);
                case StreamEventKind.Ready: return Row("ready", told.Landing, told.Segments, told.Missing);
                case StreamEventKind.Superseded: return Row("superseded", told.Landing, told.By);
                case StreamEventKind.Prefetched: return Row("prefetched", told.Count, told.Bytes);
                case StreamEventKind.Picked: return Row("picked", told.Request, told.Hit == null ? (uint?)null : told.Hit.Segment);
                case StreamEventKind.PickRefused: return Row("pick refused", told.Request, told.Code);
                case StreamEventKind.Refused: return Row("refused", told.Landing, told.Code, told.IsFatal);
                case StreamEventKind.Notice: return Row("notice", told.Notice);
                case StreamEventKind.GroupJoined: return Row("joined", group.Name, group.Member, group.Role);
                case StreamEventKind.GroupRoster:
                    return Row("roster",
                        group.Members.Select(one => Row(one.Member, one.Name, one.Role, one.IsPresent, Millimetres(one.Position))));
                case StreamEventKind.GroupCalled: return Row("called", there.Number, there.Guide, !there.IsOver);
                case StreamEventKind.GroupGathered: return Row("gathered", there.Number, there.Ready, there.Degraded, there.Missing);
                case StreamEventKind.GroupRefused: return Row("group refused", told.Request, told.Code);
                default: return null;
            }
        }

        private static object[] Row(params object[] values) { return values; }

        /// <summary>Whole numbers are written alike in every language.</summary>
        private static object[] Millimetres(Vec3? position)
        {
            if (!position.HasValue) return null;
            Vec3 at = position.Value;
            return Row(Whole(at.X), Whole(at.Y), Whole(at.Z));
        }

        private static long Whole(double metres) { return (long)Math.Floor(1000.0 * metres + 0.5); }

        /// <summary>Compact JSON; what is named by an enumeration is a lower-case text.</summary>
        private static string Json(object value)
        {
            if (value == null) return "null";
            if (value is bool) return (bool)value ? "true" : "false";
            if (value is string || value is Enum) return "\"" + (value as string ?? value.ToString().ToLowerInvariant()) + "\"";
            var list = value as IEnumerable;
            return list == null ? value.ToString() : "[" + string.Join(",", list.Cast<object>().Select(Json)) + "]";
        }

        private static T Named<T>(JsonValue name) { return (T)Enum.Parse(typeof(T), name.Text, true); }

        private static JsonValue[] Items(JsonValue list) { return Enumerable.Range(0, list.Count).Select(at => list[at]).ToArray(); }

        private static Vec3 Point(JsonValue list) { return new Vec3(Number(list[0]), Number(list[1]), Number(list[2])); }

        private static long? Integer(JsonValue value)
        {
            long integer;
            return value.TryInteger(out integer) ? integer : (long?)null;
        }

        private static double? Real(JsonValue value) { return value.IsNull ? (double?)null : Number(value); }

        /// <summary>JSON has no word for NaN and infinity, a text has.</summary>
        private static double Number(JsonValue value)
        {
            double number;
            if (value.TryNumber(out number)) return number;
            return value.Text == "nan" ? double.NaN : value.Text == "inf" ? double.PositiveInfinity : double.NegativeInfinity;
        }
    }
}
