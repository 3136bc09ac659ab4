using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// What a stream tells. Which fields count depends on <see cref="Kind"/>; the others have their default. Landing numbers
    /// stay the same over reconnects. A value type: an arrived segment allocates nothing.
    /// </summary>
    public struct StreamEvent
    {
        /// <summary>What happened; decides which of the other fields count.</summary>
        public StreamEventKind Kind;

        /// <summary>Landing that it belongs to; null for what an aim brought, and for errors of no landing.</summary>
        public int? Landing;

        /// <summary>Link: where the connection stands.</summary>
        public LinkState Link;

        /// <summary>Opened, and notices of a new version: 32 hexadecimal digits.</summary>
        public string SceneVersion;

        /// <summary>Opened: the session's name, for support.</summary>
        public string Session;

        /// <summary>Opened: the version is another one than before; base and cover must be loaded anew.</summary>
        public bool IsChanged;

        /// <summary>Opened: largest radius that the server takes, metres.</summary>
        public double MaxRadiusM;

        /// <summary>Opened: segments that were held and are valid still.</summary>
        public int HeldCount;

        /// <summary>Planned: the landing's plan; owned by the event, never changed afterwards.</summary>
        public PlanFacts Plan;

        /// <summary>Arrived: what the index says of the segment that is whole now.</summary>
        public SegmentFacts Facts;

        /// <summary>Ready, Degraded: what is to be shown, ascending. Dropped: what cannot be asked for any more.</summary>
        public IReadOnlyList<uint> Segments;

        /// <summary>Ready: what the landing should have and has not, ascending.</summary>
        public IReadOnlyList<uint> Missing;

        /// <summary>Ready: milliseconds from the call of Land until all bytes were there and verified.</summary>
        public double ElapsedMs;

        /// <summary>Ready: that moment on the stream's clock, milliseconds.</summary>
        public double ReadyAtMs;

        /// <summary>Ready: payload bytes of the landing. Prefetching, Prefetched: of the aim.</summary>
        public long Bytes;

        /// <summary>Prefetching, Prefetched: segments.</summary>
        public int Count;

        /// <summary>Superseded: the newer landing.</summary>
        public int By;

        /// <summary>Refused, PickRefused, GroupRefused: code of the wire protocol.</summary>
        public string Code;

        /// <summary>Refused, PickRefused, GroupRefused: for people.</summary>
        public string Message;

        /// <summary>Refused: the session is over.</summary>
        public bool IsFatal;

        /// <summary>Notice: its kind in the wire protocol.</summary>
        public string Notice;

        /// <summary>Notice: when to reconnect, milliseconds; null where it says nothing.</summary>
        public int? ReconnectAfterMs;

        /// <summary>Picked, PickRefused, GroupRefused: number that Pick, JoinGroup or Gather returned.</summary>
        public int Request;

        /// <summary>Picked: null where nothing was met.</summary>
        public PickHit Hit;

        /// <summary>Of a group: as it is now; null where the seat is gone.</summary>
        public GroupFacts Group;
    }
}
