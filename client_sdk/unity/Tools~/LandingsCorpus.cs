using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport.Tools
{
    /// <summary>One history of tests/conformance/landings, played by the session core.</summary>
    internal sealed class LandingsCorpus : ISessionEvents
    {
        private readonly SessionCore session;
        private readonly SegmentDecoder decoder = new SegmentDecoder();
        private readonly SegmentMesh mesh = new SegmentMesh();
        private Dictionary<string, object> told;
        private string shown = "[]", hidden = "00000000", toldShown = "[]", toldHidden = "00000000";

        private LandingsCorpus(Json options)
        {
            long credit = options["credit_bytes"].Integer.Value;
            var budgets = new Budgets { MaxSegments = options["max_segments"].Integer };
            session = new SessionCore(
                new SessionOptions { Client = "corpus", Budgets = budgets, CreditBytes = credit, CacheBytes = 1 << 30 }, this);
        }

        /// <summary>Play a history; say where it goes another way, or null.</summary>
        public static string Difference(Json history)
        {
            var player = new LandingsCorpus(history["options"]);
            int number = 0;
            foreach (IReadOnlyList<Json> step in history["steps"].List.Select(step => step.List))
            {
                string got = Canonical.Text(player.Play(step)), expected = Canonical.Text(step.Last().Value);
                if (got != expected) return "step " + number + " " + step[0].Text + ": got " + got + ", expected " + expected;
                number++;
            }
            return null;
        }

        private Dictionary<string, object> Play(IReadOnlyList<Json> step)
        {
            told = new Dictionary<string, object>();
            switch (step[0].Text)
            {
                case "connected": session.Connected(); break;
                case "lost": session.Lost(); break;
                case "receive": session.Receive(new ArraySegment<byte>(Convert.FromBase64String(step[1].Text))); break;
                case "land": session.Land(step[1].Point.Value, step[2].Number.Value, step[3].Number, step[4].Number); break;
                case "hurry": session.Hurry((int)step[1].Integer.Value); break;
                case "aim":
                    session.Aim(step[1].Point.Value, step[2].Number.Value, null);
                    session.FlushAim();
                    break;
                case "pick": session.Pick(step[1].Point.Value, null); break;
                case "send": told["sent"] = session.TakeMessages().Select(Decoded).ToList(); break;
                default: throw new ArgumentException("got step " + step[0].Text);
            }
            if (shown != toldShown) told["shown"] = session.ShownKeys.OrderBy(key => key).Select(Hex).ToList();
            if (hidden != toldHidden) told["hidden"] = hidden;
            toldShown = shown;
            toldHidden = hidden;
            return told;
        }

        public void Opened(Welcome welcome, bool isChanged)
        {
            if (isChanged) Show(new byte[0]);
        }

        public void Arrived(ulong key, byte[] payload)
        {
            try
            {
                decoder.Decode(new ArraySegment<byte>(payload), 0, mesh);
            }
            catch (PayloadException)
            {
                session.Reject(key);
                return;
            }
            session.Accept(key, mesh.Bounds, payload);
        }

        public void RestoreNeeded(ulong key) { session.LostOnDisk(key); }

        public void InnerWhole(Landing landing, List<PlanRow> rows)
        {
            told["inner"] = new object[] { rows.Count, Checksum(landing.InnerHidden) };
        }

        public void Whole(Landing landing, List<PlanRow> rows, List<uint> missing) { Show(landing.Hidden); }

        // What the corpus says nothing of.
        public void Planned(Landing landing) {}
        public void Refused(int? landing, string code, string message, bool isFatal) {}
        public void Picked(int request, PickHit hit, string code) {}
        public void Noticed(Notice notice) {}
        public void GroupChanged(GroupChange change) {}
        public void GroupRefused(int request, string code, string message) {}

        private void Show(byte[] bits)
        {
            shown = string.Join(",", session.ShownKeys.OrderBy(key => key));
            hidden = Checksum(bits);
            if (shown.Length == 0) shown = "[]";
        }

        private static object Decoded(byte[] message)
        {
            Dictionary<string, object> map = MsgpackReader.ReadMap(new ArraySegment<byte>(message));
            foreach (string key in new[] { "have", "without" })
            {
                if (!map.ContainsKey(key)) continue;
                var table = (ArraySegment<byte>)map[key];
                IEnumerable<ulong> keys =
                    Enumerable.Range(0, table.Count / 8).Select(at => LittleEndian.ReadU64(table.Array, table.Offset + 8 * at));
                map[key] = keys.OrderBy(one => one).Select(Hex).ToList();
            }
            return map;
        }

        private static string Checksum(byte[] bits) { return Crc32.Of(new ArraySegment<byte>(bits)).ToString("x8"); }

        private static string Hex(ulong key) { return key.ToString("x16"); }
    }
}
