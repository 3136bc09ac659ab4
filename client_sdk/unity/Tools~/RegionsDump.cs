using System;
using System.Collections.Generic;
using System.IO;
using System.Linq;

namespace Terraport.Tools
{
    /// <summary>Prints the places of a scene's regions, and the coarser pieces of one region.</summary>
    internal static class RegionsDump
    {
        public static int Run(string regionsPath, string labelsPath, int region)
        {
            Func<string, ArraySegment<byte>> read = path => new ArraySegment<byte>(File.ReadAllBytes(path));
            Regions regions = Regions.Read(read(regionsPath), read(labelsPath));
            Console.WriteLine(Canonical.Text(new Dictionary<string, object> {
                { "places", Places.Of(regions).Select(Row).ToList() },
                { "pieces", Places.Coarser(regions, region).Select(Row).ToList() },
            }));
            return 0;
        }

        private static object[] Row(Place place)
        {
            object position = ShownMessage.Numbers(place.Position);
            return new[] { place.Label, place.StableId, position, place.RadiusM, place.HeadingDeg, place.IsView };
        }

        private static object[] Row(CoarserPiece piece) { return new object[] { piece.Cost, piece.Regions, piece.AreaM2, piece.Label }; }
    }
}
