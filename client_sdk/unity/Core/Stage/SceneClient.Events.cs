using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport
{
    /// <content>What the session and the connection report.</content>
    internal sealed partial class SceneClient : ISessionEvents
    {
        void ISessionEvents.Opened(Welcome welcome, bool isChanged)
        {
            link.NoteWelcome();
            // Of another version than the files: what is drawn stays until the new base can be.
            if (NeedsFiles) target = null;
        }

        void ISessionEvents.Planned(Landing landing)
        {
            if (landing != newest) return;
            planned.Clear();
            plannedBytes = uploadedBytes = 0;
            foreach (PlanRow row in landing.Plan.Show)
            {
                planned[row.Key] = row;
                plannedBytes += row.PayloadBytes;
                uploadedBytes += residents.ContainsKey(row.Key) ? row.PayloadBytes : 0;
                // In memory, but not on the graphics card.
                byte[] payload = residents.ContainsKey(row.Key) ? null : session.Cache.Find(row.Key);
                if (payload != null && pending.Add(row.Key)) decoders.Enqueue(row.Key, payload);
            }
            // What superseded landings have uploaded is spare now: they may never be shown, and no swap would free it.
            Trim();
            PlanRow[] rows = landing.Plan.Show;
            var facts = new PlanFacts {
                Landing = landing.Number,
                Position = landing.Position,
                RadiusM = landing.RadiusM,
                EffectiveRadiusM = landing.Plan.EffectiveRadiusM,
                Segments = rows.Length,
                CoarserSegments = rows.Count(row => row.IsCoarser),
                LoadSegments = rows.Count(row => row.IsSent),
                LoadBytes = rows.Where(row => row.IsSent).Sum(row => (long)row.PayloadBytes),
                TotalBytes = plannedBytes,
                TotalTriangles = rows.Sum(row => (long)row.Faces),
                OmittedSegments = landing.Plan.Omitted,
                OmittedBy = landing.Plan.OmittedBy,
            };
            plan = facts;
            Raise(() => Planned?.Invoke(facts));
        }

        void ISessionEvents.Arrived(ulong key, byte[] payload)
        {
            pending.Add(key);
            decoders.Enqueue(key, payload);
        }

        void ISessionEvents.RestoreNeeded(ulong key)
        {
            // Although its upload may wait from an earlier landing: memory has let go of the payload, and the session waits for it.
            pending.Add(key);
            disk.Read(key, session.Disk[key]);
        }

        void ISessionEvents.InnerWhole(Landing landing, List<PlanRow> rows)
        {
            if (landing != newest) return;
            target = new ShownSet(landing, rows, landing.InnerHidden, false);
            Raise(() => Degraded?.Invoke(landing.Number));
        }

        void ISessionEvents.Whole(Landing landing, List<PlanRow> rows, List<uint> lost)
        {
            link.NoteSuccess();
            if (landing != newest) return;
            missing = lost;
            readyMs = readyMs ?? clock.Elapsed.TotalMilliseconds - landedAtMs;
            deadlineAtMs = null;
            target = new ShownSet(landing, rows, landing.Hidden, true);
            Raise(() => Ready?.Invoke(landing.Number));
        }

        void ISessionEvents.Refused(int? landing, string code, string message, bool isFatal)
        {
            if (isFatal) link.NoteRefusal(code, message);
            if (landing == newest?.Number && landing != null) refusal = message;
            if (!isFatal) Raise(() => Failed?.Invoke(new TerraportException(code, message)));
        }

        void ISessionEvents.Picked(int request, PickHit hit, string code) { Raise(() => Picked?.Invoke(request, hit)); }

        void ISessionEvents.Noticed(Notice notice)
        {
            if (notice.Kind == "draining") link.NoteDraining(notice.ReconnectAfterMs);
        }

        void ISessionEvents.GroupChanged(GroupChange change) { Raise(() => GroupChanged?.Invoke(change)); }

        void ISessionEvents.GroupRefused(int request, string code, string message) { Raise(() => GroupRefused?.Invoke(code, message)); }

        private void OnLink(LinkState state)
        {
            Raise(() => LinkChanged?.Invoke(state));
            if (state.Phase == LinkPhase.Closed)
                Raise(() => Failed?.Invoke(new TerraportException(state.Code, state.Message, state.CloseCode, null)));
        }
    }
}
