using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>A generation of a <see cref="SessionModelServer"/> on its way: a landing, or what an aim brings.</summary>
    internal sealed class SessionModelSending
    {
        internal readonly HashSet<uint> Rejected = new HashSet<uint>();
        internal readonly HashSet<uint> Missing = new HashSet<uint>();
        internal uint Generation;
        internal LandMessage Land;
        internal uint[] Order;
        internal uint[] Inner;
        internal List<uint> Queue;
        internal HashSet<uint> Load;
        internal int Delivered;
        internal long PayloadBytes;
        internal bool IsReadySent;
        internal bool IsDegradedSent;
    }
}
