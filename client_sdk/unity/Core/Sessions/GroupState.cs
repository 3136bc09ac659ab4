using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// The seat in a group, over all connections of a session (wire protocol, section 16): no I/O, no clock.
    /// </summary>
    internal sealed class GroupState
    {
        // Gathers that wait for an answer; beyond it the oldest is refused here.
        private const int MaxGathers = 16;

        private readonly List<WireMessage> outbox;
        private readonly Queue<StreamEvent> events;
        // In the order asked for.
        private readonly List<GatherMessage> gathers = new List<GatherMessage>();
        // As each connection is asked for it; null without a wish for a seat.
        private JoinMessage join;
        private bool isSeated;
        private GroupFacts facts;
        // The newest gathering, and what was said of it.
        private uint newest;
        private ArrivedMessage arrived;

        internal GroupState(List<WireMessage> outbox, Queue<StreamEvent> events)
        {
            this.outbox = outbox;
            this.events = events;
        }

        /// <summary>Ask for a seat; the one held before is left. A message that was checked.</summary>
        internal void Join(JoinMessage message, bool isOpen)
        {
            // Also where the new seat is refused: the caller has given the old one up.
            Leave(isOpen);
            join = message;
            if (isOpen) outbox.Add(join);
        }

        /// <summary>Give the seat up.</summary>
        internal void Leave(bool isOpen)
        {
            if (join != null && isOpen) outbox.Add(new LeaveMessage());
            Reset();
        }

        /// <summary>Land the group, now or as soon as the seat is taken again. A message that was checked.</summary>
        internal void Gather(GatherMessage gather)
        {
            gathers.Add(gather);
            if (gathers.Count > MaxGathers)
            {
                uint oldest = gathers[0].Request;
                gathers.RemoveAt(0);
                Refuse(oldest, "too_many", MaxGathers + " gathers wait for an answer already");
            }
            if (isSeated) outbox.Add(gather);
        }

        /// <summary>Say that this member's part is over, and again where a lost connection cut it off.</summary>
        internal void Arrive(ArrivedMessage message)
        {
            // A newer one has come: nobody waits for this one.
            if (message.Gathering != newest) return;
            arrived = message;
            if (isSeated) outbox.Add(message);
        }

        /// <summary>Take the seat again, on a connection that is open.</summary>
        internal void Connected(string groupsServed)
        {
            if (join == null) return;
            if (groupsServed == "here" || groupsServed == "query")
            {
                outbox.Add(join);
                return;
            }
            uint request = join.Request;
            Reset();
            Refuse(request, "group_refused", "no groups are served at this address");
        }

        /// <summary>The seat is taken again on the next connection.</summary>
        internal void ConnectionLost() { isSeated = false; }

        /// <summary>Take an error; whether it was one of a group's.</summary>
        internal bool Refused(ErrorMessage error)
        {
            if (!error.Request.HasValue) return false;
            uint request = error.Request.Value;
            if (join != null && join.Request == request)
                Reset();
            else if (gathers.RemoveAll(gather => gather.Request == request) == 0)
                return false;
            Refuse(request, error.Code, error.Message);
            return true;
        }

        /// <summary>Take a message of the group; others are skipped, and what crossed a leave.</summary>
        internal void OnMessage(WireMessage message)
        {
            if (join == null) return;
            var joined = message as JoinedMessage;
            if (joined != null)
            {
                if (joined.Request == join.Request) OnJoined(joined);
                return;
            }
            if (!isSeated) return;
            var roster = message as RosterMessage;
            var gathering = message as GatheringMessage;
            var gathered = message as GatheredMessage;
            if (roster != null && roster.Group == join.Group)
            {
                facts = facts.With(Array.ConvertAll(
                    roster.Members, one => new GroupMember(one.Member, one.Name, RoleOf(one.Role), one.Present, one.Position)));
                Report(StreamEventKind.GroupRoster);
            }
            else if (gathering != null)
            {
                OnGathering(gathering);
            }
            else if (gathered != null && gathered.Gathering == newest)
            {
                facts = facts.With(facts.Gathering.Over(gathered.Ready, gathered.Degraded, gathered.Missing));
                Report(StreamEventKind.GroupGathered);
            }
        }

        private void OnJoined(JoinedMessage joined)
        {
            isSeated = true;
            if (joined.Seat != join.Seat)
            {
                // A new seat, perhaps on a new server: its gatherings count from 1 again.
                newest = 0;
                arrived = null;
                facts = new GroupFacts(joined.Group, joined.Member, RoleOf(joined.Role));
            }
            join = new JoinMessage {
                Request = join.Request,
                Group = join.Group,
                Role = join.Role,
                Name = join.Name,
                Seat = joined.Seat,
            };
            Report(StreamEventKind.GroupJoined);
            // What was asked while the connection was away.
            outbox.AddRange(gathers);
        }

        private void OnGathering(GatheringMessage message)
        {
            if (message.Gathering == newest)
            {
                if (arrived != null && message.LeftMs.HasValue) outbox.Add(arrived);
                return;
            }
            // The guide's own request is answered by its gathering: requests are answered in order.
            newest = message.Gathering;
            arrived = null;
            gathers.Clear();
            facts = facts.With(new GroupGathering {
                Number = message.Gathering,
                Guide = message.Guide,
                Position = message.Position,
                RadiusM = message.RadiusM,
                InnerRadiusM = message.InnerRadiusM,
                LeftMs = message.LeftMs,
                IsOver = !message.LeftMs.HasValue,
            });
            Report(StreamEventKind.GroupCalled);
        }

        private void Reset()
        {
            join = null;
            isSeated = false;
            gathers.Clear();
            facts = null;
            newest = 0;
            arrived = null;
        }

        private void Report(StreamEventKind kind) { events.Enqueue(new StreamEvent { Kind = kind, Group = facts }); }

        private void Refuse(uint request, string code, string message)
        {
            events.Enqueue(new StreamEvent {
                Kind = StreamEventKind.GroupRefused,
                Group = facts,
                Request = (int)request,
                Code = code,
                Message = message,
            });
        }

        private static GroupRole RoleOf(string role) { return role == "guide" ? GroupRole.Guide : GroupRole.Member; }
    }
}
