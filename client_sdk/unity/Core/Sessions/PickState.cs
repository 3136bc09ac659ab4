using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>Picks that wait for an answer, over all connections of a session: asked again until answered or refused.</summary>
    internal sealed class PickState
    {
        // In the order asked for: a new connection gets them in the same order.
        private readonly List<PickMessage> pending = new List<PickMessage>();
        private readonly Queue<StreamEvent> events;

        internal PickState(Queue<StreamEvent> events) { this.events = events; }

        /// <summary>How many wait.</summary>
        internal int Count => pending.Count;

        /// <summary>Note a pick that was, or will be, sent.</summary>
        internal void Ask(PickMessage pick) { pending.Add(pick); }

        /// <summary>Say those that wait to a new connection.</summary>
        internal void Resend(List<WireMessage> into)
        {
            foreach (PickMessage pick in pending) into.Add(pick);
        }

        /// <summary>Take the answer to a pick; one that was refused here meanwhile is skipped.</summary>
        internal void Answered(PickedMessage picked)
        {
            if (!Remove(picked.Request)) return;
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.Picked,
                Request = (int)picked.Request,
                Hit = picked.Hit == null ? null : HitOf(picked.Hit),
            });
        }

        /// <summary>Take an error; whether it was one of a pick's.</summary>
        internal bool Refused(ErrorMessage error)
        {
            if (!error.Request.HasValue || !Remove(error.Request.Value)) return false;
            Refuse((int)error.Request.Value, error.Code, error.Message);
            return true;
        }

        /// <summary>Refuse one that waits.</summary>
        internal void RefuseRequest(uint request, string code, string message)
        {
            if (Remove(request)) Refuse((int)request, code, message);
        }

        /// <summary>Refuse all that wait: nobody answers any more.</summary>
        internal void RefuseAll(string code, string message)
        {
            foreach (PickMessage pick in pending) Refuse((int)pick.Request, code, message);
            pending.Clear();
        }

        private void Refuse(int request, string code, string message)
        {
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.PickRefused,
                Request = request,
                Code = code,
                Message = message,
            });
        }

        private bool Remove(uint request)
        {
            int index = pending.FindIndex(pick => pick.Request == request);
            if (index >= 0) pending.RemoveAt(index);
            return index >= 0;
        }

        private static PickHit HitOf(HitPart hit)
        {
            var attributes = new Dictionary<string, double>(StringComparer.Ordinal);
            foreach (KeyValuePair<string, double> attribute in hit.Attributes) attributes[attribute.Key] = attribute.Value;
            return new PickHit {
                Position = hit.Position,
                Normal = hit.Normal,
                Segment = hit.Segment,
                Region = hit.Region,
                StableId = hit.StableId,
                Label = hit.Label,
                HeightM = hit.HeightM,
                Attributes = attributes,
            };
        }
    }
}
