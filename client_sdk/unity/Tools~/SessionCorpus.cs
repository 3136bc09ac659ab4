using System;
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
        private string visible;
        private string held;
        private string unfinished;
        private string aims;

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
            visible = held = "[]";
            unfinished = "null";
            aims = "[0,0,0,0]";
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
                string sent = Perform(given);
                if (sent != "[]") told.Add("\"out\":" + sent);
            }
            catch (ProtocolViolationException)
            {
                told.Add("\"violation\":true");
            }
            catch (ArgumentException)
            {
                told.Add("\"refused\":true");
            }
            var rows = new List<string>();
            StreamEvent news;
            while (session.TryNextEvent(out news)) rows.Add(RowOf(news));
            rows.RemoveAll(row => row == null);
            if (rows.Count > 0) told.Add("\"events\":" + List(rows, row => row));
            Note("visible", ref visible, Ids(session.Visible), told);
            // The corpus' scenes have 36 segments.
            Note("held", ref held, Ids(Enumerable.Range(0, 36).Select(id => (uint)id).Where(session.Cache.Contains)), told);
            Note("unfinished", ref unfinished, session.Unfinished.HasValue ? session.Unfinished.ToString() : "null", told);
            StreamStats stats = session.Stats;
            Note("aims", ref aims,
                List(new[] { stats.AimedLandings, stats.AimHits, stats.PrefetchedBytes, stats.UsedPrefetchedBytes },
                    count => count.ToString()),
                told);
            return "{" + string.Join(",", told) + "}";
        }

        private static void Note(string key, ref string before, string now, List<string> told)
        {
            if (before != now) told.Add("\"" + key + "\":" + now);
            before = now;
        }

        /// <summary>Do one step; the numbers of the messages that are taken to be sent.</summary>
        private string Perform(JsonValue[] given)
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
                case "land": session.Land(Point(given[1]), Number(given[2]), OptionsOf(given[3], given[4])); break;
                case "aim": session.Aim(Point(given[1]), Number(given[2])); break;
                case "flush": session.FlushAim(); break;
                case "pick": session.Pick(Point(given[1]), given[2].IsNull ? (Vec3?)null : Point(given[2])); break;
                case "bye": session.Bye(); break;
                case "join":
                    session.Join(given[1].Text, given[2].Text == "guide" ? GroupRole.Guide : GroupRole.Member, given[3].Text);
                    break;
                case "leave": session.Leave(); break;
                case "gather": session.Gather(Point(given[1]), Number(given[2]), Real(given[3]), (int?)Integer(given[4])); break;
                case "arrived": session.Arrive((uint)Integer(given[1]).Value, ArrivalOf(given[2].Text)); break;
                default: throw new InvalidDataException("step " + given[0].Text);
            }
            return List(sent, data => Array.IndexOf(messages, Convert.ToBase64String(data)).ToString());
        }

        private void Receive(byte[] data, bool isText) { session.Receive(new ArraySegment<byte>(data), isText); }

        private static LandOptions OptionsOf(JsonValue inner, JsonValue deadline)
        {
            return new LandOptions { InnerRadiusM = Real(inner), DeadlineMs = (int?)Integer(deadline) };
        }

        private static GroupArrival ArrivalOf(string state) { return (GroupArrival)Enum.Parse(typeof(GroupArrival), state, true); }

        /// <summary>An event as the corpus tells it; null for those that clients name in their own ways.</summary>
        private static string RowOf(StreamEvent told)
        {
            string landing = told.Landing.HasValue ? told.Landing.ToString() : "null";
            GroupGathering gathering = told.Group == null ? null : told.Group.Gathering;
            switch (told.Kind)
            {
                case StreamEventKind.Opened: return Row("opened", Flag(told.IsChanged), told.HeldCount);
                case StreamEventKind.Planned:
                    return Row(
                        "planned", landing, Ids(told.Plan.Load.Select(facts => facts.Segment)), Ids(told.Plan.Keep), Ids(told.Plan.Nearby));
                case StreamEventKind.Arrived: return Row("arrived", landing, told.Facts.Segment);
                case StreamEventKind.Degraded: return Row("degraded", landing, Ids(told.Segments));
                case StreamEventKind.Ready: return Row("ready", landing, Ids(told.Segments), Ids(told.Missing));
                case StreamEventKind.Superseded: return Row("superseded", landing, told.By);
                case StreamEventKind.Prefetched: return Row("prefetched", told.Count, told.Bytes);
                case StreamEventKind.Picked: return Row("picked", told.Request, told.Hit == null ? "null" : told.Hit.Segment.ToString());
                case StreamEventKind.PickRefused: return Row("pick refused", told.Request, Quoted(told.Code));
                case StreamEventKind.Refused: return Row("refused", landing, Quoted(told.Code), Flag(told.IsFatal));
                case StreamEventKind.Notice: return Row("notice", Quoted(told.Notice));
                case StreamEventKind.GroupJoined: return Row("joined", Quoted(told.Group.Name), told.Group.Member, RoleOf(told.Group.Role));
                case StreamEventKind.GroupRoster:
                    return Row("roster",
                        List(told.Group.Members,
                            one => "[" + one.Member + "," + Quoted(one.Name) + "," + RoleOf(one.Role) + "," + Flag(one.IsPresent) + "]"));
                case StreamEventKind.GroupCalled: return Row("called", gathering.Number, gathering.Guide, Flag(!gathering.IsOver));
                case StreamEventKind.GroupGathered:
                    return Row("gathered", gathering.Number, Ids(gathering.Ready), Ids(gathering.Degraded), Ids(gathering.Missing));
                case StreamEventKind.GroupRefused: return Row("group refused", told.Request, Quoted(told.Code));
                default: return null;
            }
        }

        private static string Row(string name, params object[] values) { return "[\"" + name + "\"," + string.Join(",", values) + "]"; }

        private static string Quoted(string text) { return text == null ? "null" : "\"" + text + "\""; }

        private static string RoleOf(GroupRole role) { return Quoted(role.ToString().ToLowerInvariant()); }

        private static string Flag(bool flag) { return flag ? "true" : "false"; }

        private static string Ids(IEnumerable<uint> ids) { return List(ids, id => id.ToString()); }

        private static string List<T>(IEnumerable<T> items, Func<T, string> text)
        {
            return "[" + string.Join(",", items.Select(text)) + "]";
        }

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
