using System;

namespace Terraport.Wire
{
    /// <summary>
    /// A map of fields, as its table says: a message, or a part of one. Fields are read and set by their number in the table;
    /// integers pass as long, absent ones as null.
    /// </summary>
    public abstract class WirePart
    {
        internal abstract Field[] Fields { get; }

        internal abstract object Get(int field);

        internal abstract void Set(int field, object value);

        internal static Exception NoField(int field)
        {
            return new ArgumentOutOfRangeException("field", field, "expected a field of the table");
        }

        internal static T[] Parts<T>(object value)
            where T : WirePart { return value == null ? null : Array.ConvertAll((WirePart[])value, map => (T)map); }
    }
}
