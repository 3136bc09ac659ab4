using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// What is held, told to a server in messages that it takes: as much as hello takes, and the rest after the welcome (wire
    /// protocol, section 5, rule 3).
    /// </summary>
    internal sealed class HeldOffer
    {
        // Bytes of one row of a held table, and room for what stands around the table in its message.
        private const int RowBytes = 12;
        private const int AroundBytes = 64;

        private List<HeldRow> remaining = new List<HeldRow>();

        /// <summary>What goes into hello.</summary>
        /// <param name="rows">Everything that is held, most wanted first.</param>
        /// <param name="inHello">
        /// False: nothing, because the server found it too large; all of it goes after the welcome, which says how large a
        /// message may be.
        /// </param>
        internal HeldRow[] First(List<HeldRow> rows, bool inHello)
        {
            int count = inHello ? Math.Min(rows.Count, WireLimits.MaxHeldSegments) : 0;
            remaining = rows.GetRange(count, rows.Count - count);
            return rows.GetRange(0, count).ToArray();
        }

        /// <summary>Say, once, the messages that go after the welcome; returns the rows that such a server cannot be told of.</summary>
        internal List<HeldRow> OfferRest(WelcomeMessage welcome, List<WireMessage> into)
        {
            List<HeldRow> rows = remaining;
            remaining = new List<HeldRow>();
            // By the server's own message limit, which is known only after its welcome.
            long fittingRows = (welcome.Limits.MaxMessageBytes - AroundBytes) / RowBytes;
            var rowsPerMessage = (int)Math.Min(fittingRows, welcome.Limits.MaxHeldSegments);
            if (rowsPerMessage < 1) return rows;
            for (int at = 0; at < rows.Count; at += rowsPerMessage)
            {
                into.Add(new HeldMessage { Segments = rows.GetRange(at, Math.Min(rowsPerMessage, rows.Count - at)).ToArray() });
            }
            return new List<HeldRow>();
        }
    }
}
