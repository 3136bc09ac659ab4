using System;

namespace Terraport
{
    /// <summary>
    /// 16-bit linear light, as meshes have it, to the survey's own 8-bit sRGB (IEC 61966-2-1) and back: exact by nearest
    /// level.
    /// </summary>
    public static class LinearColour
    {
        private static readonly byte[] Levels = MakeLevels();
        private static readonly ushort[] Codes = MakeCodes();

        /// <summary>The nearest sRGB level, 0 to 255, of a code of 0 to 65535.</summary>
        public static byte ToSrgb(ushort code) { return Levels[code]; }

        /// <summary>The code of an sRGB level that is nearest to its light.</summary>
        public static ushort FromSrgb(byte level) { return Codes[level]; }

        private static ushort[] MakeCodes()
        {
            var codes = new ushort[256];
            for (int level = 0; level < codes.Length; level++) codes[level] = (ushort)Math.Round(Linear(level / 255.0) * 65535);
            return codes;
        }

        private static byte[] MakeLevels()
        {
            var levels = new byte[65536];
            int level = 0;
            for (int code = 0; code < levels.Length; code++)
            {
                // Both rise together: one pass over 65536 codes finds every level's threshold.
                while (level < 255 && Linear((level + 0.5) / 255) * 65535 <= code)
                {
                    level++;
                }
                levels[code] = (byte)level;
            }
            return levels;
        }

        private static double Linear(double value) { return value <= 0.04045 ? value / 12.92 : Math.Pow((value + 0.055) / 1.055, 2.4); }
    }
}
